-- Touch panel: drawing commands and pen reports.

-- Of Wireshark's own bit library, of Lua 5.2, or the operator that later Lua has.
local xor = bit and bit.bxor or bit32 and bit32.bxor
  or load("return function(a, b) return a ~ b end")()

-- CRC-16/XMODEM by a table.
local CRC = {}
for value = 0, 255 do
  local crc = value * 256
  for _ = 1, 8 do
    crc = crc >= 32768 and xor(crc * 2 % 65536, 0x1021) or crc * 2
  end
  CRC[value] = crc
end

local function crc16(s, first, last)
  local crc = 0
  for at = first, last do
    crc = xor(crc % 256 * 256, CRC[xor(math.floor(crc / 256), u8(s, at))])
  end
  return crc
end

local function judge_panel(s)
  if u8(s, 0) ~= 0x7E then return 0 end
  if #s < 4 then return nil end
  local len = be16(s, 2)
  if len > 968 then return 0 end
  if #s < len + 6 then return nil end
  return crc16(s, 1, 3 + len) == be16(s, 4 + len) and len + 6 or 0
end

local function tell_panel(s)
  local op, len = u8(s, 1), be16(s, 2)
  local items = { { f.op, op } }
  local function add(field, value) items[#items + 1] = { field, value } end
  if (op == 0x2C or op == 0xE0) and len >= 8 then
    add(f.window, string.format("%d,%d to %d,%d", be16(s, 4), be16(s, 6), be16(s, 8), be16(s, 10)))
    local pixels = math.floor((len - 8) / 2)
    if op == 0xE0 then
      pixels = 0
      for at = 12, len + 1, 3 do pixels = pixels + u8(s, at) end
    end
    add(f.drawn, pixels)
  elseif op == 0x54 and len == 5 then
    add(f.pen_down, u8(s, 4) == 1)
    add(f.pen_x, be16(s, 5))
    add(f.pen_y, be16(s, 7))
  end
  return string.format("Panel 0x%02x, %d bytes", op, len), items
end

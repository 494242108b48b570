-- Messages between robot and PC.

local MAGIC = "PCUI_MSG"
local function judge_pcui(s)
  local seen = math.min(#s, 8)
  if s:sub(1, seen) ~= MAGIC:sub(1, seen) then return 0 end
  if #s < 17 then return nil end
  local len = u16(s, 8)
  if len > 902 then return 0 end
  if #s < 17 + len then return nil end
  return sum(s, 17, 16 + len) == u32(s, 10) and 17 + len or 0
end

local function tell_row(s, items, coded)
  items[#items + 1] = { f.layer, u8(s, 17) }
  items[#items + 1] = { f.row, u16(s, 18) }
  local pixels = #s - 20
  if coded then
    pixels = 0
    for at = 20, #s - 2, 2 do pixels = pixels + u8(s, at) end
  end
  items[#items + 1] = { f.pixels, pixels }
end

local function tell_pcui(s)
  local id, len = s:sub(15, 17), u16(s, 8)
  local items = { { f.id, id }, { f.length, len } }
  local function add(field, value) items[#items + 1] = { field, value } end
  if id == "MPD" and len == 13 then
    add(f.x, i16(s, 23)); add(f.y, i16(s, 25)); add(f.layer, u8(s, 27)); add(f.psi, i16(s, 28))
  elseif (id == "MAP" or id == "MAR") and len >= 3 then
    tell_row(s, items, id == "MAR")
  elseif id == "LWP" and len >= 2 and len == 2 + 9 * u16(s, 17) then
    for at = 19, #s - 9, 9 do
      add(f.waypoint, i16(s, at + 5)); add(f.x, i16(s, at)); add(f.y, i16(s, at + 2))
    end
  elseif id == "STA" and len >= 1 then
    add(f.mode, u8(s, 17))
  end
  return string.format("PC link %s, %d bytes", id, len), items
end

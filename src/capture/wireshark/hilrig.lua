-- Decodes captures of hilrig in Wireshark: XV-11 lidar, register bus, PC link, HC-06 texts,
-- touch panel.
--
-- Wireshark reads the serial link type by itself; this adds a tree "hilrig" with the frames whose
-- last byte came in the packet. Frames split over packets are put together per link and direction.
-- The protocol of a line is the first one of which a sound frame is seen.
-- Needs nothing but Wireshark 3.4 or newer. Register names are those of the rescue robot's base.

local proto = Proto("hilrig", "hilrig serial frames")

local REGISTERS = {
--@REGISTERS
}

local f = {
  protocol = ProtoField.string("hilrig.protocol", "Protocol"),
  bad = ProtoField.uint32("hilrig.bad", "Bytes in no frame"),
  text = ProtoField.string("hilrig.text", "Text"),
  index = ProtoField.uint8("hilrig.xv11.index", "Index"),
  angle = ProtoField.uint16("hilrig.xv11.angle", "Angle (deg)"),
  rpm = ProtoField.float("hilrig.xv11.rpm", "Speed (rpm)"),
  period = ProtoField.uint16("hilrig.xv11.period", "Period word", base.HEX),
  distance = ProtoField.uint16("hilrig.xv11.distance", "Distance (mm)"),
  strength = ProtoField.uint16("hilrig.xv11.strength", "Strength"),
  weak = ProtoField.bool("hilrig.xv11.weak", "Strength warning"),
  code = ProtoField.uint8("hilrig.xv11.code", "Error code", base.HEX),
  register = ProtoField.uint8("hilrig.bus.register", "Register"),
  count = ProtoField.uint8("hilrig.bus.count", "Count"),
  write = ProtoField.bool("hilrig.bus.write", "Carries data"),
  order = ProtoField.string("hilrig.bus.order", "Checksum order"),
  name = ProtoField.string("hilrig.bus.name", "Name"),
  value = ProtoField.int32("hilrig.bus.value", "Value"),
  id = ProtoField.string("hilrig.pcui.id", "Message"),
  length = ProtoField.uint16("hilrig.pcui.length", "Payload length"),
  mode = ProtoField.uint8("hilrig.pcui.mode", "Mode", base.DEC,
    { [0] = "stop", "exploration", "waypoint", "manual" }),
  layer = ProtoField.uint8("hilrig.pcui.layer", "Layer"),
  row = ProtoField.uint16("hilrig.pcui.row", "Row"),
  pixels = ProtoField.uint32("hilrig.pcui.pixels", "Pixels"),
  x = ProtoField.int16("hilrig.pcui.x", "x (mm)"),
  y = ProtoField.int16("hilrig.pcui.y", "y (mm)"),
  psi = ProtoField.int16("hilrig.pcui.psi", "psi (deg)"),
  waypoint = ProtoField.int16("hilrig.pcui.waypoint", "Waypoint"),
  op = ProtoField.uint8("hilrig.panel.op", "Number", base.HEX,
    { [0x28] = "display off", [0x29] = "display on", [0x2C] = "write memory",
      [0xE0] = "write runs", [0x54] = "pen" }),
  window = ProtoField.string("hilrig.panel.window", "Window"),
  drawn = ProtoField.uint32("hilrig.panel.pixels", "Pixels"),
  pen_down = ProtoField.bool("hilrig.panel.pen_down", "Pen down"),
  pen_x = ProtoField.uint16("hilrig.panel.pen_x", "Pen reading x"),
  pen_y = ProtoField.uint16("hilrig.panel.pen_y", "Pen reading y"),
}
proto.fields = (function()
  local all = {}
  for _, field in pairs(f) do all[#all + 1] = field end
  return all
end)()

-- Strings as bytes -------------------------------------------------------------------------------

local function u8(s, at) return s:byte(at + 1) end
local function i8(s, at) local v = u8(s, at); return v < 128 and v or v - 256 end
local function u16(s, at) return u8(s, at) + 256 * u8(s, at + 1) end
local function i16(s, at) local v = u16(s, at); return v < 32768 and v or v - 65536 end
local function u32(s, at) return u16(s, at) + 65536 * u16(s, at + 2) end
local function i32(s, at) local v = u32(s, at); return v < 2147483648 and v or v - 4294967296 end

local function sum(s, first, last)
  local total = 0
  for at = first, last do total = total + u8(s, at) end
  return total
end

-- Formats: judge(s) says how long the frame at the start of s is; 0 for none, nil for "more" ------

local function xv11_sum(s)
  local total = 0
  for at = 0, 18, 2 do total = total * 2 + u16(s, at) end
  return (total % 32768 + math.floor(total / 32768)) % 32768
end

local function judge_xv11(s)
  if u8(s, 0) ~= 0xFA then return 0 end
  if #s < 2 then return nil end
  if u8(s, 1) < 0xA0 or u8(s, 1) > 0xF9 then return 0 end
  if #s < 22 then return nil end
  return xv11_sum(s) == u16(s, 20) and 22 or 0
end

local TURN = "\x5A\xA5\x00\xC0"
local function judge_turn(s)
  local seen = math.min(#s, 4)
  if s:sub(1, seen) ~= TURN:sub(1, seen) then return 0 end
  return #s >= 1446 and 1446 or nil
end

local function judge_bus(s, high_first)
  if u8(s, 0) ~= 0xAB then return 0 end
  if #s < 3 then return nil end
  local data = u8(s, 2) >= 128 and u8(s, 2) - 128 or 0
  if #s < data + 5 then return nil end
  local found = high_first and u8(s, 3 + data) * 256 + u8(s, 4 + data) or u16(s, 3 + data)
  return sum(s, 0, 2 + data) == found and data + 5 or 0
end

local MAGIC = "PCUI_MSG"
local function judge_pcui(s)
  local seen = math.min(#s, 8)
  if s:sub(1, seen) ~= MAGIC:sub(1, seen) then return 0 end
  if #s < 17 then return nil end
  local len = u16(s, 8)
  if len > 511 then return 0 end
  if #s < 17 + len then return nil end
  return sum(s, 17, 16 + len) == u32(s, 10) and 17 + len or 0
end

local function be16(s, at) return u8(s, at) * 256 + u8(s, at + 1) end

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

-- Words: each frame as a list of { field, value } and a title --------------------------------------

local function reading(items, s, at, degree)
  items[#items + 1] = { f.angle, degree }
  local b1 = u8(s, at + 1)
  if b1 >= 128 then
    items[#items + 1] = { f.code, u8(s, at) }
  else
    items[#items + 1] = { f.distance, u8(s, at) + 256 * (b1 % 64) }
    items[#items + 1] = { f.weak, b1 % 128 >= 64 }
  end
  items[#items + 1] = { f.strength, u16(s, at + 2) }
end

local function tell_xv11(s)
  local index = u8(s, 1) - 0xA0
  local items = { { f.index, index }, { f.rpm, u16(s, 2) / 64 } }
  for k = 0, 3 do reading(items, s, 4 + 4 * k, 4 * index + k) end
  return string.format("XV-11 packet %d, %.2f rpm", index, u16(s, 2) / 64), items
end

local function tell_turn(s)
  local items = { { f.period, u16(s, 4) } }
  for degree = 0, 359 do reading(items, s, 6 + 4 * degree, degree) end
  return string.format("XV-11 turn, period word 0x%04x", u16(s, 4)), items
end

local READ = { u8 = u8, i8 = i8, i16 = i16, i32 = i32 }
local WIDTH = { u8 = 1, i8 = 1, i16 = 2, i32 = 4 }

local function tell_bus(s, high_first)
  local register, data = u8(s, 1), #s - 5
  local writes = u8(s, 2) >= 128
  local count = u8(s, 2) % 128
  local items = {
    { f.register, register }, { f.count, count }, { f.write, writes },
    { f.order, high_first and "high byte first" or "low byte first" },
  }
  local names = {}
  local at = register
  while at < register + math.max(count, 1) do
    local known = REGISTERS[at]
    local width = known and WIDTH[known[2]] or 1
    if known then
      names[#names + 1] = known[1]
      items[#items + 1] = { f.name, known[1] }
      if writes and at - register + width <= data then
        items[#items + 1] = { f.value, READ[known[2]](s, 3 + at - register) }
      end
    end
    at = at + width
  end
  local what = writes and "data of" or (count > 0 and "read" or "acknowledge")
  if not writes and count == 0 and register == 255 then what = "error" end
  return string.format("Bus %s %d: %s", what, register, table.concat(names, " ")), items
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

local FORMATS = {
  { "xv11", judge_xv11, tell_xv11 },
  { "xv11-turn", judge_turn, tell_turn },
  { "bus", function(s) return judge_bus(s, false) end, function(s) return tell_bus(s, false) end },
  { "bus-high-first", function(s) return judge_bus(s, true) end,
    function(s) return tell_bus(s, true) end },
  { "pcui", judge_pcui, tell_pcui },
  { "panel", judge_panel, tell_panel },
}

-- Lines: bytes that wait, per link and direction ---------------------------------------------------

local QUIET = 0.05
local PENDING_MAX = 4096
local lines, told = {}, {}

function proto.init() lines, told = {}, {} end

-- Printable runs among bytes that are no frame are text, e.g. commands of an HC-06.
local function tell_bad(out, bytes)
  if #bytes == 0 then return end
  if bytes:find("^[\t\r\n -~]+$") and #bytes >= 2 then
    local shown = bytes:gsub("\r", "\\r"):gsub("\n", "\\n"):gsub("\t", "\\t")
    out[#out + 1] = { "text", "Text " .. shown, { { f.text, shown } }, bytes }
    return
  end
  local at, last = bytes:find("[\t\r\n -~][\t\r\n -~][\t\r\n -~][\t\r\n -~]+")
  if at then
    tell_bad(out, bytes:sub(1, at - 1))
    tell_bad(out, bytes:sub(at, last))
    tell_bad(out, bytes:sub(last + 1))
    return
  end
  out[#out + 1] = { "bad", #bytes .. " bytes in no frame", { { f.bad, #bytes } }, bytes }
end

-- Cuts what is settled off line.buf; all of it if the line is quiet.
local function cut(line, out, quiet)
  local format, at, from = line.format, 1, 1
  while at <= #line.buf do
    local length = format[2](line.buf:sub(at, at + 1445))
    if length == nil and not quiet then break end
    if length and length > 0 then
      tell_bad(out, line.buf:sub(from, at - 1))
      local bytes = line.buf:sub(at, at + length - 1)
      local title, items = format[3](bytes)
      out[#out + 1] = { format[1], title, items, bytes }
      at = at + length
      from = at
    else
      at = at + 1
    end
  end
  tell_bad(out, line.buf:sub(from, at - 1))
  line.buf = line.buf:sub(at)
end

-- The format with the most bytes in sound frames.
local function guess(buf)
  local best, most = nil, 0
  for _, format in ipairs(FORMATS) do
    local at, framed = 1, 0
    while at <= #buf do
      local length = format[2](buf:sub(at, at + 1445))
      if length and length > 0 then framed = framed + length end
      at = at + math.max(length or 1, 1)
    end
    if framed > most then best, most = format, framed end
  end
  return best
end

local function take(line, bytes, time)
  local out = {}
  if line.time and time - line.time > QUIET and #line.buf > 0 then
    if line.format then cut(line, out, true) else tell_bad(out, line.buf); line.buf = "" end
  end
  line.time = time
  line.buf = line.buf .. bytes
  line.format = line.format or guess(line.buf)
  if line.format then
    cut(line, out, false)
  elseif #line.buf > PENDING_MAX or line.buf:find("^AT[%w+=:?]*\r?\n?$") or line.buf:find("^OK") then
    tell_bad(out, line.buf)
    line.buf = ""
  end
  return out
end

-- In Wireshark ------------------------------------------------------------------------------------

local interface = Field.new("frame.interface_id")
local direction = Field.new("frame.packet_flags_direction")
local event = Field.new("rtacser.eventtype")

local function field_text(field)
  local value = field()
  return value and tostring(value) or "?"
end

function proto.dissector(tvb, pinfo, tree)
  local kind = event()
  if not kind or tvb:len() <= 12 then return end
  if not told[pinfo.number] then
    local key = field_text(interface) .. "/" .. field_text(direction)
    lines[key] = lines[key] or { buf = "" }
    local bytes = tvb:range(12):bytes():raw()
    told[pinfo.number] = take(lines[key], bytes, tonumber(tostring(pinfo.abs_ts)))
  end
  for _, one in ipairs(told[pinfo.number]) do
    local name, title, items, bytes = one[1], one[2], one[3], one[4]
    local hex = bytes:gsub(".", function(c) return string.format("%02x", c:byte()) end)
    local data = ByteArray.new(hex):tvb(name)
    local branch = tree:add(proto, data(), "hilrig " .. title)
    branch:add(f.protocol, data(), name)
    for _, item in ipairs(items) do branch:add(item[1], data(), item[2]) end
    pinfo.cols.info:append(" [" .. title .. "]")
  end
end

register_postdissector(proto)

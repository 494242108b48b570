-- Decodes captures of hilrig in Wireshark: the formats of its table, and HC-06 texts.
--
-- Wireshark reads the serial link type by itself; this adds a tree "hilrig" with the frames whose
-- last byte came in the packet. Frames split over packets are put together per link and direction.
-- The protocol of a line is that of the first valid frame on it.
-- Needs nothing but Wireshark 3.4 or newer. Register names are those of the rescue robot's base.

local proto = Proto("hilrig", "hilrig serial frames")

local REGISTERS = {
--@REGISTERS
}

local f = {
  protocol = ProtoField.string("hilrig.protocol", "Protocol"),
  bad = ProtoField.uint32("hilrig.bad", "Bytes in no frame"),
  text = ProtoField.string("hilrig.text", "Text"),
--@FIELDS
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
local function be16(s, at) return u8(s, at) * 256 + u8(s, at + 1) end
local function i16(s, at) local v = u16(s, at); return v < 32768 and v or v - 65536 end
local function u32(s, at) return u16(s, at) + 65536 * u16(s, at + 2) end
local function i32(s, at) local v = u32(s, at); return v < 2147483648 and v or v - 4294967296 end

local function sum(s, first, last)
  local total = 0
  for at = first, last do total = total + u8(s, at) end
  return total
end

-- Formats ----------------------------------------------------------------------------------------
--
-- judge(s, state) returns the length of the frame at the start of s: 0 for no frame, nil if more bytes
-- are needed. state is a table of the line, for formats whose frames announce the next ones;
-- state.before is the byte before s, nil at the start of the line. tell(s) returns a title
-- and a list of { field, value }. Each row: name, judge, tell, seconds of silence after which a partial
-- frame is discarded, minimum per cent of the bytes in frames for a guess; for a described
-- device also a function that tests whether a frame is one of its messages.

--@SOURCES
local FORMATS = {
--@FORMATS
}

-- Lines: bytes that wait, per link and direction ---------------------------------------------------

local QUIET = 0.05
local PENDING_MAX = 4096
local FRAME_MAX = 6407
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

-- Removes the decided bytes from line.buf; all bytes if the line is quiet.
local function cut(line, out, quiet)
  local format, at, from = line.format, 1, 1
  while at <= #line.buf do
    local length = format[2](line.buf:sub(at, at + FRAME_MAX - 1), line.state, quiet)
    if length == nil and not quiet then break end
    if length and length > 0 then
      tell_bad(out, line.buf:sub(from, at - 1))
      local bytes = line.buf:sub(at, at + length - 1)
      local title, items = format[3](bytes, line.state)
      out[#out + 1] = { format[1], title, items, bytes }
      at = at + length
      from = at
    else
      at = at + 1
    end
    line.state.before = line.buf:sub(at - 1, at - 1)
  end
  tell_bad(out, line.buf:sub(from, at - 1))
  line.buf = line.buf:sub(at)
end

-- The format with the most bytes in valid frames. A format of a described device goes before others
-- if its function finds a message of the device.
local function guess(buf, from, quiet)
  local best, most = nil, 0
  for _, format in ipairs(FORMATS) do
    local at, framed, state = 1, 0, { from = from }
    while at <= #buf do
      local length = format[2](buf:sub(at, at + FRAME_MAX - 1), state, quiet)
      if length and length > 0 and (not format[6] or format[6](buf:sub(at, at + length - 1), state)) then
        framed = framed + length
      end
      at = at + math.max(length or 1, 1)
      state.before = buf:sub(at - 1, at - 1)
    end
    local is_later = best and best[6] and not format[6]
    if not is_later and framed > most and framed * 100 >= format[5] * #buf then
      best, most = format, framed
    end
  end
  return best
end

local function take(line, bytes, time)
  local out = {}
  local quiet = line.format and line.format[4] or QUIET
  if line.time and time - line.time > quiet and #line.buf > 0 then
    line.format = line.format or guess(line.buf, line.state.from, true)
    if line.format then cut(line, out, true) else tell_bad(out, line.buf); line.buf = "" end
  end
  line.time = time
  line.buf = line.buf .. bytes
  line.format = line.format or guess(line.buf, line.state.from)
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
    local way = direction()
    local from = way and ({ "device", "host" })[tonumber(way.value)]
    lines[key] = lines[key] or { buf = "", state = { from = from } }
    local bytes = tvb:range(12):bytes():raw()
    told[pinfo.number] = take(lines[key], bytes, tonumber(tostring(pinfo.abs_ts)))
  end
  for _, one in ipairs(told[pinfo.number]) do
    local name, title, items, bytes = one[1], one[2], one[3], one[4]
    local hex = bytes:gsub(".", function(c) return string.format("%02x", c:byte()) end)
    local data = ByteArray.new(hex):tvb(name)
    local branch = tree:add(proto, data(), "hilrig " .. title)
    branch:add(f.protocol, data(), name)
    for _, item in ipairs(items) do
      local added = branch:add(item[1], data(), item[2])
      if item[3] then added:append_text(item[3]) end
    end
    pinfo.cols.info:append(" [" .. title .. "]")
  end
end

register_postdissector(proto)

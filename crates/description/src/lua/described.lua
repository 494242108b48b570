-- Described devices: the same reading of a description as the command `hilrig decode` has, on
-- tables that are made from the file.

local D = {}

-- Values. Numbers are plain; a whole number that a double cannot hold is { v, text, hi, lo }. Text is
-- a string, bytes are { bytes }, a list is { list }, a group { record }.
local function is_big(v) return type(v) == "table" and v.text ~= nil end
local function nearest(v) return is_big(v) and v.v or v end
local function is_number(v) return type(v) == "number" or is_big(v) end

local function decimal(s)
  local digits = { 0 }
  for i = 1, #s do
    local carry = s:byte(i)
    for j = 1, #digits do
      local x = digits[j] * 256 + carry
      digits[j] = x % 10000000
      carry = math.floor(x / 10000000)
    end
    if carry > 0 then digits[#digits + 1] = carry end
  end
  local out = string.format("%d", digits[#digits])
  for j = #digits - 1, 1, -1 do out = out .. string.format("%07d", digits[j]) end
  return out
end

local function word(s, from)
  local v = 0.0
  for i = from, from + 3 do v = v * 256 + s:byte(i) end
  return v
end

local function unsigned(s)
  local v = 0.0
  for i = 1, #s do v = v * 256 + s:byte(i) end
  if v < 9007199254740992 then return v end
  local wide = ("\0"):rep(8 - #s) .. s
  return { v = v, text = decimal(s), hi = word(wide, 1), lo = word(wide, 5) }
end

local function negative(s)
  local bytes, carry = {}, 1
  for i = #s, 1, -1 do
    local x = 255 - s:byte(i) + carry
    bytes[i], carry = string.char(x % 256), x > 255 and 1 or 0
  end
  local size = unsigned(table.concat(bytes))
  if not is_big(size) then return -size end
  return { v = -size.v, text = "-" .. size.text, hi = word(s, 1), lo = word(s, 5) }
end

local function signed(s)
  if s:byte(1) >= 128 then return negative(s) end
  return unsigned(s)
end

local function float(s)
  local a, b = s:byte(1, 2)
  local sign = a >= 128 and -1 or 1
  local exponent, mantissa, bias, bits
  if #s == 4 then
    exponent, mantissa, bias, bits = a % 128 * 2 + math.floor(b / 128), b % 128 + 0.0, 127, 23
  else
    exponent, mantissa, bias, bits = a % 128 * 16 + math.floor(b / 16), b % 16 + 0.0, 1023, 52
  end
  for i = 3, #s do mantissa = mantissa * 256 + s:byte(i) end
  if exponent == 2 * bias + 1 then
    if mantissa ~= 0 then return 0 / 0 end
    return sign * math.huge
  end
  if exponent == 0 then return sign * mantissa * 2.0 ^ (1 - bias - bits) end
  return sign * (1 + mantissa / 2.0 ^ bits) * 2.0 ^ (exponent - bias)
end

-- Values in words ---------------------------------------------------------------------------------

local function shortest(v)
  for precision = 0, 16 do
    local text = string.format("%." .. precision .. "e", v)
    if tonumber(text) == v then return text end
  end
  return string.format("%.17e", v)
end

local function laid_out(text)
  local sign, lead, rest, exponent = text:match("^(-?)(%d)%.?(%d*)e([-+]%d+)$")
  local digits = (lead .. rest):gsub("0+$", "")
  local point = tonumber(exponent) + 1
  if digits == "" then return sign .. "0" end
  if point <= 0 then return sign .. "0." .. ("0"):rep(-point) .. digits end
  if point >= #digits then return sign .. digits .. ("0"):rep(point - #digits) end
  return sign .. digits:sub(1, point) .. "." .. digits:sub(point + 1)
end

local function number_text(v)
  if is_big(v) then return v.text end
  if v ~= v then return "NaN" end
  if v == math.huge then return "inf" elseif v == -math.huge then return "-inf" end
  if v == 0 then return 1 / v < 0 and "-0" or "0" end
  local plain = laid_out(shortest(v))
  if #plain <= 9 then return plain end
  local short = laid_out(shortest(tonumber(string.format("%.6e", v))))
  return #short < #plain and short or plain
end

local ESCAPES = { ["\t"] = "\\t", ["\r"] = "\\r", ["\n"] = "\\n", ["'"] = "\\'", ['"'] = '\\"', ["\\"] = "\\\\" }

local function hex(s, space)
  local pairs = {}
  for i = 1, #s do pairs[i] = string.format("%02X", s:byte(i)) end
  return table.concat(pairs, space)
end

local function quoted(s)
  local text = s:gsub(".", function(c)
    if ESCAPES[c] then return ESCAPES[c] end
    local byte = c:byte()
    return (byte < 32 or byte > 126) and string.format("\\u{%x}", byte) or c
  end)
  -- The dot of a pattern is no line end in some versions.
  return '"' .. text:gsub("\n", "\\n") .. '"'
end

local words_of

local function plain_words(v)
  if is_number(v) then return number_text(v) end
  if type(v) == "string" then return quoted(v) end
  if v.bytes then return "[" .. hex(v.bytes, " ") .. "]" end
  local all = {}
  if v.list then
    for i, one in ipairs(v.list) do all[i] = plain_words(one) end
    return "[" .. table.concat(all, ", ") .. "]"
  end
  for i, one in ipairs(v.record) do all[i] = one[1] .. " " .. plain_words(one[2]) end
  return "{" .. table.concat(all, ", ") .. "}"
end

local function int_of(v)
  v = nearest(v)
  if type(v) ~= "number" or v ~= v or v == math.huge or v == -math.huge then return nil end
  return v >= 0 and math.floor(v + 0.5) or -math.floor(-v + 0.5)
end

local function words(field, v)
  if type(v) == "table" and v.list then
    local all = {}
    for i, one in ipairs(v.list) do all[i] = words(field, one) end
    return "[" .. table.concat(all, ", ") .. "]"
  end
  if type(v) == "table" and v.record then return "{" .. words_of(v.record) .. "}" end
  local int = int_of(v)
  if field.names and int and field.names[int] then return field.names[int] end
  if field.flags and int and int >= 0 then
    local set, rest = {}, int
    for bit, name in ipairs(field.flags) do
      local place = 2.0 ^ (bit - 1)
      if name ~= "" and math.floor(int / place) % 2 == 1 then
        set[#set + 1], rest = name, rest - place
      end
    end
    local more = rest > 0 and string.format(" +0x%x", rest) or ""
    if #set == 0 and more == "" then return "none" end
    return table.concat(set, "|") .. more
  end
  local text = plain_words(v)
  return field.unit and text .. " " .. field.unit or text
end

function words_of(record)
  local all = {}
  for _, one in ipairs(record) do
    all[#all + 1] = one[1] .. " " .. words(one[3], one[2])
  end
  return table.concat(all, ", ")
end

-- Expressions: functions of a scope, a list of records from the inside to the outside --------------

local function find(record, name)
  for _, one in ipairs(record) do
    if one[1] == name then return one[2] end
  end
  local outer, inner = name:match("^([^.]*)%.(.*)$")
  local group = outer and find(record, outer)
  if type(group) == "table" and group.record then return find(group.record, inner) end
  return nil
end

function D.value(scope, name)
  for _, record in ipairs(scope) do
    local found = find(record, name)
    if found ~= nil then return found end
  end
  error("there is no value " .. name)
end

local function numeric(v)
  v = nearest(v)
  if type(v) ~= "number" then error("expected a number") end
  return v
end

local function bytes_of(v) return type(v) == "table" and v.bytes or v end

function D.truth(v)
  if is_number(v) then return nearest(v) ~= 0 end
  if type(v) == "string" then return v ~= "" end
  return #(v.bytes or v.list or v.record) > 0
end

local function yes(is) return is and 1 or 0 end

local function equal(a, b)
  if is_number(a) and is_number(b) then
    return is_big(a) and is_big(b) and a.text == b.text or nearest(a) == nearest(b)
  end
  return bytes_of(a) == bytes_of(b)
end

local function less(a, b)
  a, b = bytes_of(nearest(a)), bytes_of(nearest(b))
  if type(a) ~= type(b) or type(a) == "table" then error("cannot be compared") end
  return a < b
end

-- Bits of whole numbers, as two words of 32 bits.
local function bitwise(a, b, of)
  a, b = numeric(a), numeric(b)
  local value, place = 0.0, 1.0
  for i = 1, 53 do
    local x, y = a % 2, b % 2
    if of(x, y) then value = value + place end
    a, b, place = math.floor(a / 2), math.floor(b / 2), place * 2
  end
  -- The remaining high bits of a negative number are all 1, which is -1.
  if of(a < 0 and 1 or 0, b < 0 and 1 or 0) then value = value - place end
  return value
end

D.op = {
  add = function(a, b)
    if type(a) == "string" and type(b) == "string" then return a .. b end
    if type(a) == "table" and a.bytes then return { bytes = a.bytes .. bytes_of(b) } end
    return numeric(a) + numeric(b)
  end,
  sub = function(a, b) return numeric(a) - numeric(b) end,
  mul = function(a, b) return numeric(a) * numeric(b) end,
  div = function(a, b)
    if numeric(b) == 0 then error("division by 0") end
    return numeric(a) / numeric(b)
  end,
  down = function(a, b)
    if numeric(b) == 0 then error("division by 0") end
    return math.floor(numeric(a) / numeric(b))
  end,
  rest = function(a, b)
    if numeric(b) == 0 then error("division by 0") end
    a, b = numeric(a), numeric(b)
    return a - b * math.floor(a / b)
  end,
  left = function(a, b) return numeric(a) * 2.0 ^ numeric(b) end,
  right = function(a, b) return math.floor(numeric(a) / 2.0 ^ numeric(b)) end,
  band = function(a, b) return bitwise(a, b, function(x, y) return x == 1 and y == 1 end) end,
  bor = function(a, b) return bitwise(a, b, function(x, y) return x == 1 or y == 1 end) end,
  bxor = function(a, b) return bitwise(a, b, function(x, y) return x ~= y end) end,
  eq = function(a, b) return yes(equal(a, b)) end,
  ne = function(a, b) return yes(not equal(a, b)) end,
  lt = function(a, b) return yes(less(a, b)) end,
  le = function(a, b) return yes(less(a, b) or equal(a, b)) end,
  gt = function(a, b) return yes(less(b, a)) end,
  ge = function(a, b) return yes(less(b, a) or equal(a, b)) end,
  minus = function(a) return -numeric(a) end,
  invert = function(a) return -1 - numeric(a) end,
  ["not"] = function(a) return yes(not D.truth(a)) end,
  at = function(of, index)
    local at = numeric(index) + 1
    local found
    if type(of) == "string" then
      found = at >= 1 and of:sub(at, at) or ""
      found = found ~= "" and found or nil
    elseif of.bytes then
      found = at >= 1 and of.bytes:byte(at) or nil
    else
      found = of.list[at]
    end
    if found == nil then error("there is no such element") end
    return found
  end,
}

local function rounded(v)
  v = numeric(v)
  return v >= 0 and math.floor(v + 0.5) or -math.floor(-v + 0.5)
end

local function text_of(v)
  if type(v) == "string" then return v end
  return type(v) == "table" and v.bytes or plain_words(v)
end

local function pick(a, b, is_more)
  local takes = equal(a, b) or (is_more and less(b, a)) or (not is_more and less(a, b))
  return takes and a or b
end

D.call = {
  abs = function(a) return math.abs(numeric(a)) end,
  bit = function(a, place) return math.floor(rounded(a) / 2.0 ^ numeric(place)) % 2 end,
  bytes = function(...)
    local all = {}
    for i, one in ipairs({ ... }) do
      all[i] = is_number(one) and string.char(numeric(one)) or bytes_of(one)
    end
    return { bytes = table.concat(all) }
  end,
  ceil = function(a) return math.ceil(numeric(a)) end,
  clamp = function(a, least, most) return pick(pick(a, least, true), most, false) end,
  float = function(a)
    return type(a) == "string" and (tonumber(a) or error("no number")) or numeric(a)
  end,
  floor = function(a) return math.floor(numeric(a)) end,
  int = function(a)
    local v = type(a) == "string" and (tonumber(a) or error("no number")) or numeric(a)
    return v >= 0 and math.floor(v) or -math.floor(-v)
  end,
  len = function(a) return #(type(a) == "string" and a or a.bytes or a.list) end,
  lower = function(a) return text_of(a):lower() end,
  upper = function(a) return text_of(a):upper() end,
  max = function(first, ...)
    for _, one in ipairs({ ... }) do first = pick(first, one, true) end
    return first
  end,
  min = function(first, ...)
    for _, one in ipairs({ ... }) do first = pick(first, one, false) end
    return first
  end,
  registers = function() error("no registers here") end,
  round = function(a, digits)
    if not digits then return rounded(a) end
    local scale = 10.0 ^ numeric(digits)
    return rounded(numeric(a) * scale) / scale
  end,
  sqrt = function(a)
    if numeric(a) < 0 then error("no root") end
    return math.sqrt(numeric(a))
  end,
  text = function(a, digits)
    if not digits then return text_of(a) end
    return string.format("%." .. digits .. "f", numeric(a))
  end,
}

-- Checksums: functions of bytes and of the number of bytes that are wanted, highest first ----------

local function wide(v, count)
  local bytes = {}
  for i = count, 1, -1 do
    bytes[i] = string.char(v % 256)
    v = math.floor(v / 256)
  end
  return table.concat(bytes)
end

local function fit(s, count)
  return #s >= count and s:sub(-count) or ("\0"):rep(count - #s) .. s
end

local function byte_sum(s)
  local all = 0
  for i = 1, #s do all = all + s:byte(i) end
  return all
end

local function inverted(s)
  return (s:gsub("[%z\1-\255]", function(c) return string.char(255 - c:byte()) end))
end

local function xored(s, with)
  local out = {}
  for i = 1, #s do
    local a, b, v = s:byte(i), with:byte(i), 0
    for bit = 0, 7 do
      local place = 2 ^ bit
      if math.floor(a / place) % 2 ~= math.floor(b / place) % 2 then v = v + place end
    end
    out[i] = string.char(v)
  end
  return table.concat(out)
end

local XOR = {}
for a = 0, 255 do
  XOR[a] = {}
  for b = 0, 255 do XOR[a][b] = xored(string.char(a), string.char(b)):byte() end
end

local function words_low_first(s)
  local at = -1
  return function()
    at = at + 2
    if at > #s then return nil end
    return s:byte(at) + 256 * (s:byte(at + 1) or 0)
  end
end

local function fletcher(next_part, modulus)
  local first, second = 0, 0
  for part in next_part do
    first = (first + part) % modulus
    second = (second + first) % modulus
  end
  return first, second
end

local function each_byte(s)
  local at = 0
  return function()
    at = at + 1
    return s:byte(at)
  end
end

-- The low bits of a checksum, and a number that is added to them.
function D.part(sum, bits, plus)
  return function(s, count)
    local out, carry, all = {}, plus, sum(s, count)
    for i = count, 1, -1 do
      local kept = math.min(math.max(bits - 8 * (count - i), 0), 8)
      carry = carry + all:byte(i) % 2 ^ kept
      out[i] = string.char(math.floor(carry % 256))
      carry = math.floor(carry / 256)
    end
    return table.concat(out)
  end
end

D.sum = {
  add = function(s, count) return wide(byte_sum(s), count) end,
  twos = function(s, count)
    local total = byte_sum(s)
    return fit(total == 0 and ("\0"):rep(8) or inverted(wide(total - 1, 8)), count)
  end,
  ones = function(s, count) return fit(inverted(wide(byte_sum(s), 8)), count) end,
  xor = function(s, count)
    local all = 0
    for i = 1, #s do all = XOR[all][s:byte(i)] end
    return wide(all, count)
  end,
  xor16 = function(s, count)
    local low, high = 0, 0
    for part in words_low_first(s) do
      low, high = XOR[low][part % 256], XOR[high][math.floor(part / 256)]
    end
    return wide(high * 256 + low, count)
  end,
  fletcher = function(modulus)
    return function(s, count)
      local first, second = fletcher(each_byte(s), modulus)
      return wide(second * 256 + first, count)
    end
  end,
  fletcher32 = function(s, count)
    local first, second = fletcher(words_low_first(s), 65535)
    return wide(second * 65536 + first, count)
  end,
  adler32 = function(s, count)
    local low, high = 1, 0
    for byte in each_byte(s) do
      low = (low + byte) % 65521
      high = (high + low) % 65521
    end
    return wide(high * 65536 + low, count)
  end,
  internet = function(s, count)
    local all = 0
    for i = 1, #s, 2 do all = all + s:byte(i) * 256 + (s:byte(i + 1) or 0) end
    while all > 65535 do all = all % 65536 + math.floor(all / 65536) end
    return wide(65535 - all, count)
  end,
  lin = function(s, count)
    local all = byte_sum(s)
    while all > 255 do all = all % 256 + math.floor(all / 256) end
    return wide(255 - all, count)
  end,
  xv11 = function(s, count)
    local all = 0
    for part in words_low_first(s) do all = (all * 2 + part) % 4294967296 end
    return wide((all % 32768 + math.floor(all / 32768)) % 32768, count)
  end,
}

local function bits_reversed(v, count)
  local out = 0
  for _ = 1, count do
    out, v = out * 2 + v % 2, math.floor(v / 2)
  end
  return out
end

-- A CRC of any width: its register is a list of bytes, highest first, as far left as it goes.
function D.crc(width, poly, init, refin, refout, xorout)
  local size = #poly
  local pad = 8 * size - width
  local steps, reflected = {}, {}
  for byte = 0, 255 do
    reflected[byte] = refin and bits_reversed(byte, 8) or byte
    local register = { byte }
    for i = 2, size do register[i] = 0 end
    for _ = 1, 8 do
      local top, carry = register[1] >= 128, 0
      for i = size, 1, -1 do
        local x = register[i] * 2 + carry
        register[i], carry = x % 256, math.floor(x / 256)
      end
      if top then
        for i = 1, size do register[i] = XOR[register[i]][poly:byte(i)] end
      end
    end
    steps[byte] = register
  end
  return function(s, count)
    local register = { init:byte(1, -1) }
    for at = 1, #s do
      local step = steps[XOR[register[1]][reflected[s:byte(at)]]]
      for i = 1, size do register[i] = XOR[step[i]][register[i + 1] or 0] end
    end
    local bits = {}
    for i = 1, size do
      for place = 7, 0, -1 do bits[#bits + 1] = math.floor(register[i] / 2 ^ place) % 2 end
    end
    -- The first `width` bits are the register.
    local out = {}
    for i = 1, size do out[i] = 0 end
    for i = 1, width do
      local bit = bits[refout and width + 1 - i or i]
      local place = pad + i - 1
      local byte = math.floor(place / 8) + 1
      out[byte] = out[byte] + bit * 2 ^ (7 - place % 8)
    end
    for i = 1, size do out[i] = string.char(XOR[out[i]][xorout:byte(i)]) end
    return fit(table.concat(out), count)
  end
end

-- Frames ------------------------------------------------------------------------------------------

local function escaped(s, escape, known)
  local out, at = {}, 1
  while at <= #s do
    local byte = s:byte(at)
    if byte == escape then
      at = at + 1
      local plain = known(s:byte(at))
      if not plain then return nil end
      out[#out + 1] = string.char(plain)
    else
      out[#out + 1] = string.char(byte)
    end
    at = at + 1
  end
  return table.concat(out)
end

local UNSTUFFED = {
  none = function(s) return s end,
  slip = function(s)
    return escaped(s, 0xDB, function(byte) return byte == 0xDC and 0xC0 or byte == 0xDD and 0xDB end)
  end,
  hdlc = function(s)
    return escaped(s, 0x7D, function(byte)
      return byte and byte ~= 0x7D and XOR[byte][0x20] or nil
    end)
  end,
  cobs = function(s)
    local out, at = {}, 1
    while at <= #s do
      local code = s:byte(at)
      if code == 0 or at + code - 1 > #s then return nil end
      out[#out + 1] = s:sub(at + 1, at + code - 1)
      at = at + code
      if code < 255 and at <= #s then out[#out + 1] = "\0" end
    end
    return table.concat(out)
  end,
  dle = function(s)
    return escaped(s, 0x10, function(byte) return byte == 0x10 and byte or nil end)
  end,
}

-- The place of the first DLE that begins the end marker: a DLE of the content is sent twice. 0 if a
-- DLE begins neither of the two.
local function dle_end(s, finish)
  local at = 1
  while at < #s do
    if s:byte(at) ~= 0x10 then
      at = at + 1
    elseif s:byte(at + 1) == 0x10 then
      at = at + 2
    elseif s:sub(at, at + #finish - 1) == finish then
      return at
    else
      return 0
    end
  end
  return nil
end

local function hex_bytes(s)
  if #s % 2 == 1 or s:find("%X") then return nil end
  return (s:gsub("..", function(pair) return string.char(tonumber(pair, 16)) end))
end

local function content(framing, frame)
  if framing.cut ~= "marked" then return frame end
  local inner = frame
  if frame:sub(1, #framing.start) == framing.start then inner = frame:sub(#framing.start + 1) end
  local len = #inner - framing.tail - #framing.finish
  if len < 0 then return nil end
  local plain = UNSTUFFED[framing.stuffing](inner:sub(1, len))
  if not plain then return nil end
  plain = plain .. inner:sub(len + #framing.finish + 1)
  if framing.is_hex then return hex_bytes(plain) end
  return plain
end

local function place(at, len)
  if at < 0 then at = at + len end
  return at >= 0 and at <= len and at or nil
end

local function holds(check, s)
  local at, from = place(check.at, #s), place(check.from, #s)
  local to = check.to == 0 and #s or check.to and place(check.to, #s) or not check.to and at
  if not at or not from or not to or from > to then return false end
  local first = at + #check.separator
  -- A checksum within what it covers counts as 0.
  local covered = s
  if at < to and first + check.len > from then
    covered = s:sub(1, at) .. ("\0"):rep(first + check.len - at) .. s:sub(first + check.len + 1)
  end
  local expected = check.sum(check.before .. covered:sub(from + 1, to) .. check.extra, check.width)
  local written = s:sub(first + 1, first + check.len)
  if #written ~= check.len or s:sub(at + 1, first) ~= check.separator then return false end
  if check.is_hex then written = hex_bytes(written) end
  if written and check.is_little then written = written:reverse() end
  return written == expected
end

local function sound(framing, s)
  for _, check in ipairs(framing.checks) do
    if not holds(check, s) then return false end
  end
  return true
end

-- Whether a frame of complete length is valid.
local function whole(framing, frame)
  if #framing.last > 0 and frame:sub(-#framing.last) ~= framing.last then return 0 end
  return sound(framing, frame) and #frame or 0
end

-- The possible lengths of a Modbus frame of `from`, the most probable one first.
local function modbus_lengths(s, from)
  local code = s:byte(2)
  if not code then return {} end
  local third, seventh, eleventh = s:byte(3), s:byte(7), s:byte(11)
  local request, response
  if code >= 1 and code <= 4 then
    request, response = 8, third and 5 + third
  elseif code == 5 or code == 6 then
    request, response = 8, 8
  elseif code == 15 or code == 16 then
    request, response = seventh and 9 + seventh, 8
  elseif code == 22 then
    request, response = 10, 10
  elseif code == 23 then
    request, response = eleventh and 13 + eleventh or 15, third and 5 + third
  elseif code >= 0x81 and code <= 0x97 then
    request, response = 5, 5
  else
    return nil
  end
  if not request or not response then return {} end
  if request == response then return { request } end
  local is_response_first = from == "device" or (from ~= "host" and response > request)
  return is_response_first and { response, request } or { request, response }
end

-- The CRC of a sound frame that ends with 0 also holds without its last byte, so a less probable
-- length waits for the bytes of the more probable one.
local function judge_lengths(framing, s, is_last, known)
  local damaged
  for _, len in ipairs(known) do
    if len > #s then
      if not is_last then return nil end
    else
      local found = whole(framing, s:sub(1, len))
      if found > 0 then
        if damaged ~= #s or damaged ~= len + 1 then return found end
        if is_last then return 0 end
        return nil
      end
      damaged = damaged or len
    end
  end
  return damaged and 0 or nil
end

local function judge_silence(framing, s, is_last, from)
  local known = framing.is_modbus and modbus_lengths(s, from)
  if known then
    if #known == 0 then return nil end
    return judge_lengths(framing, s, is_last, known)
  end
  if is_last then
    local found = whole(framing, s)
    return #s < framing.least and 0 or found
  end
  if #s >= framing.max then return 0 end
  return nil
end

local function judge_marked(framing, s, before)
  local start, finish = framing.start, framing.finish
  local seen = math.min(#start, #s)
  local has_start = s:sub(1, seen) == start:sub(1, seen)
  -- Two adjacent frames may share a marker; within a damaged frame, none begins.
  local may_share = start == finish and (not before or before == finish:sub(-1))
  if not has_start and not may_share then return 0 end
  if has_start and seen < #start then return nil end
  local from = has_start and #start or 0
  local inner = s:sub(from + 1)
  local is_line = start == "" and framing.stuffing == "none" and not framing.has_blank
  if is_line and inner:find("^[\r\n]") and finish:find("[\r\n]") then return 0 end
  local found
  if framing.stuffing == "dle" then
    found = dle_end(inner, finish)
    if found == 0 then return 0 end
  else
    found = inner:find(finish, 1, true)
  end
  if not found then
    if #s >= framing.max then return 0 end
    return nil
  end
  found = found - 1
  local len = from + found + #finish + framing.tail
  if len > framing.max then return 0 end
  if found == 0 and framing.tail == 0 and not framing.has_blank then return 0 end
  if #s < len then return nil end
  local plain = content(framing, s:sub(1, len))
  if not plain or #plain < framing.least or not sound(framing, plain) then return 0 end
  if #framing.last > 0 and plain:sub(-#framing.last) ~= framing.last then return 0 end
  return len
end

local function judge_one(framing, s, is_last, from, before)
  if framing.cut == "marked" then return judge_marked(framing, s, before) end
  local sync = framing.sync
  local seen = math.min(#sync, #s)
  if s:sub(1, seen) ~= sync:sub(1, seen) then return 0 end
  if framing.cut == "silence" then return judge_silence(framing, s, is_last, from) end
  local size = framing.size
  if framing.cut == "length" then
    local at, again, len = framing.length.at, framing.length.again, framing.length.number.bytes
    if again and #s >= again + len and s:sub(again + 1, again + len) ~= s:sub(at + 1, at + len) then
      return 0
    end
    if #s < at + len then return nil end
    size = framing.length.of(s)
    if size < framing.least then return 0 end
  elseif framing.cut == "sized" then
    if #s < framing.head then return nil end
    local is_sound, said = pcall(framing.of, s:sub(1, framing.head))
    said = is_sound and int_of(said)
    if not said or said < framing.least or said > 2000 then return 0 end
    size = said
  elseif framing.cut == "table" then
    local byte = s:byte(framing.at + 1)
    if not byte then return nil end
    size = framing.sizes[byte]
    if not size then return 0 end
  end
  if size > framing.max then return 0 end
  if #s < size then return nil end
  return whole(framing, s:sub(1, size))
end

-- Formats of the end that sends come first, the others last: a capture may have its ends mixed up.
local function judge(device, s, is_last, from, before)
  for _, is_other in ipairs(from and { false, true } or { false }) do
    for index, framing in ipairs(device.frames) do
      local is_own = not from or not framing.from or framing.from == from
      if is_own ~= is_other then
        local found = judge_one(framing, s, is_last, from, before)
        if found == nil and not is_last then return nil end
        if found and found > 0 then return found, index end
      end
    end
  end
  return 0
end

local function body(framing, frame)
  local s = content(framing, frame)
  local out, at = {}, 0
  for _, hole in ipairs(framing.holes) do
    out[#out + 1] = s:sub(at + 1, math.min(hole[1], #s - framing.trailer))
    at = hole[1] + hole[2]
  end
  out[#out + 1] = s:sub(at + 1, #s - framing.trailer)
  local inner, shared = table.concat(out), framing.shared
  if not shared then return inner end
  -- The bits of a length in a field of the message are 0.
  local field = {}
  for i = 1, #shared.keep do
    field[i] = string.char(D.op.band(inner:byte(shared.at + i), shared.keep[i]))
  end
  return inner:sub(1, shared.at) .. table.concat(field) .. inner:sub(shared.at + #shared.keep + 1)
end

-- Messages ----------------------------------------------------------------------------------------

-- The bytes of a number, highest first.
function D.ordered(number, s)
  local out = {}
  for i, at in ipairs(number.order) do out[i] = s:sub(at, at) end
  return table.concat(out)
end

function D.number(number, s)
  local bytes = D.ordered(number, s)
  if number.kind == "f" then return float(bytes) end
  return number.kind == "i" and signed(bytes) or unsigned(bytes)
end

local NO = {}

local function whole_number(digits)
  local sign, plain = digits:match("^([-+]?)0*(%d*)$")
  if #plain < 16 then return tonumber(sign == "-" and "-" .. plain .. "0" or plain .. "0") / 10 end
  local v = tonumber(plain)
  if sign ~= "-" then return { v = v, text = plain, hi = 0, lo = 0 } end
  return { v = -v, text = "-" .. plain, hi = 0, lo = 0 }
end

local function scaled(field, v)
  if field.scale and is_number(v) then return nearest(v) * field.scale[1] + field.scale[2] end
  return v
end

local decode

local READ = {
  number = function(field, reader) return D.number(field.number, reader.take(field.number.bytes)) end,
  bits = function(field, reader)
    local bytes, bits = {}, {}
    for i = 1, field.bits do bits[i] = reader.bit(field.is_low_first) end
    for i = 1, 64 do
      local from_low = 65 - i
      local at = field.is_low_first and from_low or field.bits - from_low + 1
      local byte = math.floor((i - 1) / 8) + 1
      bytes[byte] = (bytes[byte] or 0) * 2 + (at >= 1 and bits[at] or 0)
    end
    return unsigned(string.char(bytes[1], bytes[2], bytes[3], bytes[4], bytes[5], bytes[6], bytes[7], bytes[8]))
  end,
  bcd = function(field, reader, size)
    local bytes = reader.take(size)
    local digits = hex(field.is_low_first and bytes:reverse() or bytes, "")
    if digits:find("%D") then error(NO) end
    return whole_number(digits)
  end,
  decimal = function(field, reader, size)
    local digits = reader.take(size)
    if not digits:find("^[-+]?%d+$") then error(NO) end
    return whole_number(digits)
  end,
  hex = function(field, reader, size)
    local digits = reader.take(size)
    local bytes = hex_bytes(#digits % 2 == 1 and "0" .. digits or digits)
    if not bytes or #bytes > 8 then error(NO) end
    return unsigned(bytes)
  end,
  str = function(field, reader, size)
    local text = reader.take(size)
    return field.is_padded and text:gsub("%z+$", "") or text
  end,
  strz = function(field, reader)
    local len = reader.zero()
    local text = reader.take(len)
    reader.take(1)
    return text
  end,
  bytes = function(field, reader, size) return { bytes = reader.take(size) } end,
  prefixed = function(field, reader)
    local len = nearest(D.number(field.number, reader.take(field.number.bytes)))
    local bytes = reader.take(len)
    return field.is_text and bytes or { bytes = bytes }
  end,
  pad = function(field, reader, size)
    reader.take(size)
    return { bytes = "" }
  end,
  group = function(field, reader, _, scope)
    local record = {}
    decode(field.fields, reader, record, scope)
    return { record = record }
  end,
}

local function size_of(size, scope, left)
  if size == "rest" then return left end
  if type(size) == "number" then return size end
  local found = int_of(size(scope))
  if not found or found < 0 or found > 4096 then error(NO) end
  return found
end

local function inside(record, scope)
  local inner = { record }
  for i, outer in ipairs(scope) do inner[i + 1] = outer end
  return inner
end

local function one(field, reader, scope)
  local size = field.size and size_of(field.size, scope, reader.left())
  local value = READ[field.type](field, reader, size, scope)
  if field.type == "pad" or field.type == "group" then return value end
  return scaled(field, value)
end

function decode(fields, reader, record, outer)
  local scope = inside(record, outer)
  for _, field in ipairs(fields) do
    if field.is_optional and reader.left() == 0 then return end
    if not field.condition or D.truth(field.condition(scope)) then
      if field.type == "switch" then
        local on, chosen = field.on(scope), field.other
        for _, case in ipairs(field.cases) do
          if equal(case[1], on) then
            chosen = case[2]
            break
          end
        end
        if not chosen then error(NO) end
        decode(chosen, reader, record, outer)
      else
        local value
        if not field.times then
          value = one(field, reader, scope)
        elseif field.times == "rest" then
          value = { list = {} }
          while reader.left() > 0 do
            local left = reader.left()
            value.list[#value.list + 1] = one(field, reader, scope)
            if reader.left() == left and reader.is_whole() then error(NO) end
          end
        else
          value = { list = {} }
          for _ = 1, size_of(field.times, scope, 0) do
            value.list[#value.list + 1] = one(field, reader, scope)
          end
        end
        if field.constant ~= nil and not equal(field.constant, value) then error(NO) end
        if field.name and field.type ~= "pad" then record[#record + 1] = { field.name, value, field } end
      end
    end
  end
end

local function reader_of(s)
  local at, bit = 1, 0
  return {
    left = function() return #s - at + 1 end,
    is_whole = function() return bit == 0 end,
    zero = function()
      local found = s:find("\0", at, true)
      if not found or bit ~= 0 then error(NO) end
      return found - at
    end,
    take = function(len)
      if bit ~= 0 or at + len - 1 > #s then error(NO) end
      at = at + len
      return s:sub(at - len, at - 1)
    end,
    bit = function(is_low_first)
      local byte = s:byte(at)
      if not byte then error(NO) end
      local found = math.floor(byte / 2 ^ (is_low_first and bit or 7 - bit)) % 2
      bit = bit + 1
      if bit == 8 then at, bit = at + 1, 0 end
      return found
    end,
  }
end

local function read_hole(hole, text)
  local plain = text:gsub("^ +", "")
  local digits = plain:gsub("^[-+]", "", 1)
  local starts_well = digits:find("^[%d.]")
  local function int()
    return starts_well and plain:find("^[-+]?%d+$") and whole_number(plain) or nil
  end
  local function fraction()
    local form = digits:match("^%d*%.?%d*$") or digits:match("^%d*%.?%d*[eE][-+]?%d+$")
    if not starts_well or not form or not digits:find("^%.?%d") then return nil end
    local v = tonumber(digits)
    if not v or v == math.huge then return nil end
    return plain:sub(1, 1) == "-" and -v or v
  end
  if hole.form == "text" then
    return hole.width > 0 and text:gsub(" +$", "") or text
  elseif hole.form == "plain" then
    local v = int()
    if v == nil then v = fraction() end
    return v
  elseif hole.form == "decimal" then
    return int()
  elseif hole.form == "fixed" then
    return fraction()
  end
  if plain == "" or plain:find("%X") then return nil end
  return unsigned(hex_bytes(#plain % 2 == 1 and "0" .. plain or plain))
end

local function decode_text(pieces, text)
  local record, rest = {}, text
  for i, hole in ipairs(pieces) do
    if type(hole) == "string" then
      if rest:sub(1, #hole) ~= hole then error(NO) end
      rest = rest:sub(#hole + 1)
    else
      local behind = pieces[i + 1]
      local words = type(behind) == "string" and behind
      local stop
      if hole.fixed and words and hole.is_optional and rest:sub(1, #words) == words then
        stop = 0
      elseif hole.fixed and (hole.form == "text" or type(behind) == "table") then
        stop = hole.fixed
      elseif words then
        local found = rest:find(words, 1, true)
        if not found then error(NO) end
        stop = found - 1
      else
        stop = #rest
      end
      if stop > #rest then error(NO) end
      local text = rest:sub(1, stop)
      rest = rest:sub(stop + 1)
      if text ~= "" or not hole.is_optional then
        local value = read_hole(hole, text)
        if value == nil then error(NO) end
        value = scaled(hole, value)
        if hole.constant ~= nil and not equal(hole.constant, value) then error(NO) end
        record[#record + 1] = { hole.name, value, hole }
      end
    end
  end
  if rest ~= "" then error(NO) end
  return record
end

-- The first message that fits a body, and its values.
local function understand(device, index, s, from)
  for _, message in ipairs(device.messages) do
    if message.frame == index and (not from or not message.from or message.from == from) then
      local is_it, record = pcall(function()
        if message.pieces then return decode_text(message.pieces, s) end
        local record, reader = {}, reader_of(s)
        decode(message.fields, reader, record, {})
        if reader.left() > 0 or not reader.is_whole() then error(NO) end
        return record
      end)
      if is_it then return message, record end
    end
  end
end

-- Modbus in words ---------------------------------------------------------------------------------

local FUNCTIONS = {
  [1] = "read coils", [2] = "read discrete inputs", [3] = "read holding registers",
  [4] = "read input registers", [5] = "write coil", [6] = "write register", [15] = "write coils",
  [16] = "write registers", [22] = "mask register", [23] = "exchange registers",
}
local REFUSALS = {
  "illegal function", "illegal data address", "illegal data value", "device failure",
  "acknowledge", "busy",
}

-- A request to read from 0x0300 on has the form of a response with 3 bytes.
local function is_read_response(code, rest, from)
  local count = #rest - 1
  return rest:byte(1) == count and not (count == 3 and (code > 2 or from == "host"))
end

local function modbus(s, from)
  local address, code = s:byte(1, 2)
  if not code then return "too short for Modbus", {} end
  local name, rest = FUNCTIONS[code % 128] or "unknown function", s:sub(3)
  local items = { { f.modbus_address, address }, { f.modbus_function, code } }
  local function be(at) return rest:byte(at) * 256 + rest:byte(at + 1) end
  local function values(bytes)
    local all = {}
    for i = 1, #bytes, 2 do
      local high, low = bytes:byte(i, i + 1)
      all[#all + 1] = low and tostring(high * 256 + low) or string.format("[%02X]", high)
    end
    return table.concat(all, " ")
  end
  local function listed(bytes) return "[" .. hex(bytes, ", ") .. "]" end
  local said
  if code >= 128 and #rest > 0 then
    local why = rest:byte(1)
    items[#items + 1] = { f.modbus_exception, why }
    said = string.format("refused %s: %s (%d)", name, REFUSALS[why] or "unknown", why)
  elseif code >= 1 and code <= 4 and is_read_response(code, rest, from) then
    local bytes = rest:sub(2)
    items[#items + 1] = { f.modbus_data, hex(bytes, " ") }
    said = name .. ": " .. (code <= 2 and listed(bytes) or values(bytes))
  elseif code >= 1 and code <= 6 and #rest == 4 then
    items[#items + 1] = { f.modbus_register, be(1) }
    if code >= 5 then
      items[#items + 1] = { f.modbus_data, hex(rest:sub(3), " ") }
      said = string.format("%s %d = %d", name, be(1), be(3))
    else
      items[#items + 1] = { f.modbus_count, be(3) }
      said = string.format("%s %d, %d of them", name, be(1), be(3))
    end
  elseif (code == 15 or code == 16) and #rest >= 4 then
    items[#items + 1] = { f.modbus_register, be(1) }
    items[#items + 1] = { f.modbus_count, be(3) }
    if #rest == 4 then
      said = string.format("%s %d, %d of them: done", name, be(1), be(3))
    else
      local bytes = rest:sub(6)
      items[#items + 1] = { f.modbus_data, hex(bytes, " ") }
      if code == 16 then
        said = string.format("%s %d = %s", name, be(1), values(bytes))
      else
        said = string.format("%s %d, %d of them = %s", name, be(1), be(3), listed(bytes))
      end
    end
  else
    items[#items + 1] = { f.modbus_data, hex(rest, " ") }
    said = name .. ": " .. listed(rest)
  end
  return string.format("device %d: %s", address, said), items
end

-- Items of the tree: a field, its value in the form that the field wants, and the text beside it.
local function add_items(items, record)
  for _, entry in ipairs(record) do
    local field, value = entry[3], entry[2]
    local all = type(value) == "table" and value.list or { value }
    for _, v in ipairs(all) do
      if type(v) == "table" and v.record then
        add_items(items, v.record)
      elseif field.show then
        local beside, shown = "", nil
        if field.show == "string" then
          shown = type(v) == "string" and v or plain_words(v)
        elseif is_number(v) then
          shown = nearest(v)
          if field.show == "int64" then
            shown = is_big(v) and Int64.new(v.lo, v.hi) or Int64.new(v)
          elseif field.show == "uint64" then
            shown = is_big(v) and UInt64.new(v.lo, v.hi) or UInt64.new(v)
          end
          beside = words(field, v)
        end
        if shown ~= nil then
          items[#items + 1] = { f[field.key], shown, beside ~= "" and " (" .. beside .. ")" or nil }
        end
      end
    end
  end
end

-- A row of the table of formats.
function D.row(device)
  local function of(s, from)
    local _, index = judge(device, s, true, from)
    index = index or 1
    local s = body(device.frames[index], s)
    if device.is_modbus then return nil, nil, s end
    local message, record = understand(device, index, s, from)
    if not message and from then message, record = understand(device, index, s) end
    return message, record, s
  end
  return {
    device.name,
    function(s, state, is_last) return (judge(device, s, is_last, state.from, state.before)) end,
    function(s, state)
      local message, record, inner = of(s, state.from)
      local title, items
      if device.is_modbus then
        title, items = modbus(inner, state.from)
      elseif not message then
        title, items = "unknown message: " .. hex(inner, " "), {}
      else
        local said = words_of(record)
        title = said == "" and message.name or message.name .. ": " .. said
        items = { { f.message, message.name } }
        add_items(items, record)
      end
      table.insert(items, 1, { f.words, title })
      return title, items
    end,
    device.idle,
    device.share,
    function(s, state) return device.is_modbus or of(s, state.from) ~= nil end,
  }
end

-- Open Sound Control: address, types, arguments, each padded with zeros to four bytes.

-- The text at a place and where the next part begins; 0 for none, nil if that takes more bytes.
local function osc_text(s, at)
  local zero = s:find("[^!-~]", at + 1)
  if not zero then return nil end
  local len = zero - 1 - at
  local next_part = at + (math.floor(len / 4) + 1) * 4
  if s:sub(zero, next_part):find("[^%z]") then return nil, 0 end
  if #s < next_part then return nil end
  return s:sub(at + 1, zero - 1), next_part
end

local OSC_LENGTHS = { i = 4, f = 4, h = 8, d = 8, t = 8, T = 0, F = 0, N = 0, I = 0 }

-- The length of the message, its address, its types and where its arguments begin.
local function read_osc(s)
  if u8(s, 0) ~= 0x2F then return 0 end
  local address, at = osc_text(s, 0)
  if not address then return at end
  if #s == at then return nil end
  if u8(s, at) ~= 0x2C then return 0 end
  local types, arguments = osc_text(s, at)
  if not types then return arguments end
  local len = arguments
  for kind in types:sub(2):gmatch(".") do
    if not OSC_LENGTHS[kind] then return 0 end
    len = len + OSC_LENGTHS[kind]
  end
  if len > 256 then return 0 end
  if #s < len then return nil end
  return len, address, types:sub(2), arguments
end

local function judge_osc(s)
  local len = read_osc(s)
  if len == nil and #s >= 256 then return 0 end
  return len
end

local function osc_float(s, at)
  local b = { s:byte(at + 1, at + 4) }
  local exponent = b[1] % 128 * 2 + math.floor(b[2] / 128)
  local fraction = (b[2] % 128 * 65536 + b[3] * 256 + b[4]) / 2 ^ 23
  local value = exponent == 0 and fraction * 2 ^ -126 or (1 + fraction) * 2 ^ (exponent - 127)
  return b[1] >= 128 and -value or value
end

local function tell_osc(s)
  local _, address, types, at = read_osc(s)
  local items = { { f.osc_address, address }, { f.osc_types, types } }
  local title = "OSC " .. address
  for kind in types:gmatch(".") do
    if kind == "f" then
      local value = osc_float(s, at)
      items[#items + 1] = { f.osc_float, value }
      title = string.format("%s %g", title, value)
    end
    at = at + OSC_LENGTHS[kind]
  end
  return title, items
end

-- RPLIDAR: requests one way; answers, nodes and capsules the other. What a line streams is kept in
-- its state, as the descriptor said.

-- Of Wireshark's own bit library, of Lua 5.2, or the operator that later Lua has.
local rp_xor = bit and bit.bxor or bit32 and bit32.bxor
  or load("return function(a, b) return a ~ b end")()

local function xor_of(s, first, last)
  local total = 0
  for at = first, last do total = rp_xor(total, u8(s, at)) end
  return total
end

local PLAIN = { [0x20] = 1, [0x21] = 1, [0x25] = 1, [0x40] = 1, [0x50] = 1, [0x52] = 1, [0x59] = 1 }
-- Least and greatest length of what an answer of this kind announces.
local SINGLE = { [0x04] = { 20, 20 }, [0x06] = { 3, 3 }, [0x15] = { 4, 4 }, [0xFF] = { 4, 4 },
    [0x20] = { 4, 128 } }
local STREAM = { [0x81] = { 5, 5 }, [0x82] = { 84, 84 }, [0x84] = { 132, 132 } }

-- How long the answer is; known is true if its kind and length are.
local function answer_length(s)
  if #s < 7 then return nil end
  local len, mode = u16(s, 2) + 65536 * u8(s, 4), u8(s, 5)
  local most = mode == 0x40 and u8(s, 6) == 0x84 and 132 or 128
  if len > most or mode ~= 0 and mode ~= 0x40 then return 0 end
  local range = (mode == 0 and SINGLE or STREAM)[u8(s, 6)]
  if range and (len < range[1] or len > range[2]) then return 0 end
  return mode == 0 and 7 + len or 7, range ~= nil
end

local function is_node(s, at)
  local start = u8(s, at) % 4
  return (start == 1 or start == 2) and u8(s, at + 1) % 2 == 1
end

local function judge_stream(s, stream)
  if stream ~= 0x81 then
    local size = STREAM[stream][1]
    if math.floor(u8(s, 0) / 16) ~= 0xA then return 0 end
    if #s < size then return nil end
    local sum = xor_of(s, 2, size - 1)
    local found = u8(s, 0) % 16 + u8(s, 1) % 16 * 16
    return math.floor(u8(s, 1) / 16) == 5 and found == sum and size or 0
  end
  if #s < 5 then return nil end
  return is_node(s, 0) and 5 or 0
end

local function judge_rplidar(s, state)
  if u8(s, 0) == 0xA5 and #s < 2 then return nil end
  if u8(s, 0) == 0xA5 and u8(s, 1) == 0x5A then
    local len, known = answer_length(s)
    if len == nil then return nil end
    if len > #s then return nil end
    if len > 0 and (known or not state.rplidar) then
      state.rplidar = STREAM[u8(s, 6)] and u8(s, 5) == 0x40 and u8(s, 6) or nil
      return len
    end
  end
  if state.rplidar then return judge_stream(s, state.rplidar) end
  if u8(s, 0) ~= 0xA5 then return 0 end
  if u8(s, 1) < 128 then return PLAIN[u8(s, 1)] and 2 or 0 end
  if #s < 3 then return nil end
  local len = u8(s, 2)
  if len > 128 then return 0 end
  if #s < len + 4 then return nil end
  return xor_of(s, 0, len + 2) == u8(s, len + 3) and len + 4 or 0
end

local function tell_rplidar(s)
  if #s >= 7 and u8(s, 1) == 0x5A then
    return string.format("RPLIDAR answer 0x%02x", u8(s, 6)), { { f.rp_kind, u8(s, 6) } }
  elseif #s == 84 then
    local angle = (u16(s, 2) % 32768) / 64
    local items = { { f.rp_angle, angle }, { f.rp_start, u8(s, 3) >= 128 } }
    for at = 4, 79, 5 do
      items[#items + 1] = { f.rp_distance, math.floor(u16(s, at) / 4) }
      items[#items + 1] = { f.rp_distance, math.floor(u16(s, at + 2) / 4) }
    end
    return string.format("RPLIDAR capsule from %.2f deg", angle), items
  elseif #s == 132 then
    local angle = (u16(s, 2) % 32768) / 64
    local items = { { f.rp_angle, angle }, { f.rp_start, u8(s, 3) >= 128 } }
    for at = 4, 128, 4 do
      local code, mm = u16(s, at) % 4096, 0
      if code >= 3328 then mm = 16384 + (code - 3328) * 16
      elseif code >= 1792 then mm = 4096 + (code - 1792) * 8
      elseif code >= 1280 then mm = 2048 + (code - 1280) * 4
      elseif code >= 512 then mm = 512 + (code - 512) * 2
      else mm = code end
      items[#items + 1] = { f.rp_distance, mm }
    end
    return string.format("RPLIDAR capsule of kind 0x84 from %.2f deg", angle), items
  elseif #s == 5 and is_node(s, 0) then
    local angle, distance = math.floor(u16(s, 1) / 2) / 64, u16(s, 3) / 4
    return string.format("RPLIDAR node %.2f deg, %.2f mm", angle, distance), {
      { f.rp_angle, angle }, { f.rp_distance, distance },
      { f.rp_quality, math.floor(u8(s, 0) / 4) }, { f.rp_start, u8(s, 0) % 2 == 1 },
    }
  end
  return string.format("RPLIDAR request 0x%02x", u8(s, 1)), { { f.rp_command, u8(s, 1) } }
end

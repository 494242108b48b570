-- Telemetry of the robot yellow: escaped frames behind 7E.

-- The payload and the frame's length; 0 for none, nil if that takes more bytes.
local function read_telemetry(s)
  if u8(s, 0) ~= 0x7E then return nil, 0 end
  local plain, at = {}, 1
  local wanted = 2
  while #plain < wanted do
    if at >= #s then return nil, nil end
    local byte = u8(s, at)
    if byte == 0x7E then return nil, 0 end
    if byte == 0x7D then
      at = at + 1
      if at >= #s then return nil, nil end
      byte = u8(s, at) == 0x5E and 0x7E or u8(s, at) == 0x5D and 0x7D
      if not byte then return nil, 0 end
    end
    plain[#plain + 1] = byte
    at = at + 1
    if #plain == 2 then
      local len = plain[1] * 256 + plain[2]
      if len > 3200 then return nil, 0 end
      wanted = len + 3
    end
  end
  local total, shown = 0, {}
  for index = 3, wanted do total = total + plain[index] end
  for index = 3, wanted - 1 do shown[#shown + 1] = string.format("%02X", plain[index]) end
  if total % 256 ~= 255 then return nil, 0 end
  return shown, at
end

local function judge_telemetry(s)
  local _, length = read_telemetry(s)
  return length
end

local function tell_telemetry(s)
  local shown = read_telemetry(s)
  local payload = table.concat(shown, " ", 1, math.min(#shown, 64))
  return string.format("Telemetry, %d bytes", #shown),
    { { f.tele_length, #shown }, { f.tele_payload, payload } }
end

-- Messages of a camera's program: D a row of depths, S a scan, M a marker.

local function judge_perception(s)
  local kind = u8(s, 0)
  if kind == 0x4D then return #s >= 19 and 19 or nil end
  if kind ~= 0x44 and kind ~= 0x53 then return 0 end
  if #s < 3 then return nil end
  local count = u16(s, 1)
  if count > 700 then return 0 end
  local len = 2 * count + (kind == 0x44 and 5 or 11)
  return #s >= len and len or nil
end

local function tell_perception(s)
  if u8(s, 0) == 0x4D then
    local id, right, ahead = u16(s, 1), i32(s, 3), i32(s, 11)
    return string.format("Marker %d, %d mm ahead", id, ahead),
      { { f.perc_id, id }, { f.perc_ahead, ahead }, { f.perc_right, right } }
  end
  local count, nearest = u16(s, 1), 65535
  local first = u8(s, 0) == 0x44 and 5 or 11
  for at = first, first + 2 * count - 2, 2 do
    local value = u16(s, at)
    if value > 0 and value < nearest then nearest = value end
  end
  return string.format("%s of %d", first == 5 and "Depths" or "Scan", count),
    { { f.perc_count, count }, { f.perc_nearest, nearest } }
end

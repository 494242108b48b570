-- Board of a model car: frames behind 00 0F without a checksum; commands of one byte, in pairs.

local function judge_car_board(s)
  if u8(s, 0) ~= 0 then return 0 end
  if #s > 1 and u8(s, 1) ~= 0x0F then return 0 end
  if #s < 13 then return nil end
  for at = 2, 6, 2 do
    if u16(s, at) > 1100 then return 0 end
  end
  local battery = u16(s, 11)
  if u8(s, 8) > 1 or battery < 4000 or battery > 10000 then return 0 end
  -- What follows, if anything has come yet, is the next frame.
  if #s > 13 and u8(s, 13) ~= 0 or #s > 14 and u8(s, 14) ~= 0x0F then return 0 end
  return 13
end

local function tell_car_board(s)
  local front, right, left = u16(s, 2), u16(s, 4), u16(s, 6)
  return string.format("Car %d cm ahead, %d right, %d left", front, right, left), {
    { f.car_range, front },
    { f.car_range, right },
    { f.car_range, left },
    { f.car_line, u8(s, 8) == 1 },
    { f.car_hall, u16(s, 9) },
    { f.car_battery, u16(s, 11) },
  }
end

local function judge_car_command(s)
  if u8(s, 0) < 0x80 or u8(s, 0) > 0x94 then return 0 end
  if #s < 2 then return nil end
  return u8(s, 1) <= 0x64 and 2 or 0
end

local function tell_car_command(s)
  local level, steering = u8(s, 0) - 0x8A, u8(s, 1) - 0x32
  return string.format("Motor %d, steering %d", level, steering),
    { { f.car_level, level }, { f.car_steering, steering } }
end

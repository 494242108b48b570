-- Registers of timers, PWM and ADC: 80 begins a sample, 81 outputs; seven bits a byte, the lowest
-- first.

local function judge_peripherals(s)
  local len = ({ [0x80] = 12, [0x81] = 6 })[u8(s, 0)]
  if not len then return 0 end
  for at = 1, math.min(len, #s) - 1 do
    if u8(s, at) >= 0x80 then return 0 end
  end
  if #s < len then return nil end
  return len
end

local function groups(s, at, count)
  local value, weight = 0, 1
  for index = at, at + count - 1 do
    value = value + u8(s, index) * weight
    weight = weight * 128
  end
  return value
end

local function tell_peripherals(s)
  if u8(s, 0) == 0x80 then
    local last = u8(s, 11)
    local left, right = groups(s, 1, 3) % 65536, groups(s, 4, 3) % 65536
    return string.format("Sample %d %d", left, right), {
      { f.per_counter, left },
      { f.per_counter, right },
      { f.per_adc, math.min(groups(s, 7, 2), 4095) },
      { f.per_channel, last % 8 },
      { f.per_supply, groups(s, 9, 2) / 100 },
      { f.per_button, math.floor(last / 8) % 2 == 1 },
    }
  end
  local last = u8(s, 5)
  local left = math.min(groups(s, 1, 2), 10000) / 100
  local right = math.min(groups(s, 3, 2), 10000) / 100
  return string.format("Outputs %g %% %g %%", left, right), {
    { f.per_duty, left },
    { f.per_duty, right },
    { f.per_channel, last % 8 },
    { f.per_enable, math.floor(last / 8) % 2 == 1 },
  }
end

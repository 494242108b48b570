-- XV-11 lidar: packets of four readings, and the whole turns of firmware 2.1.

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

-- Register bus, with either order of its checksum.

local function judge_bus(s, high_first)
  if u8(s, 0) ~= 0xAB then return 0 end
  if #s < 3 then return nil end
  local data = u8(s, 2) >= 128 and u8(s, 2) - 128 or 0
  if #s < data + 5 then return nil end
  local found = high_first and u8(s, 3 + data) * 256 + u8(s, 4 + data) or u16(s, 3 + data)
  return sum(s, 0, 2 + data) == found and data + 5 or 0
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

local function judge_bus_low_first(s) return judge_bus(s, false) end
local function judge_bus_high_first(s) return judge_bus(s, true) end
local function tell_bus_low_first(s) return tell_bus(s, false) end
local function tell_bus_high_first(s) return tell_bus(s, true) end

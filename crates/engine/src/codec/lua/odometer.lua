-- Lines of an odometer: figures with a * behind each. # begins one without a sum; a sum without a
-- point is a CRC; a time without a point is in milliseconds.

local function odometer_figures(line)
  local figures, texts = {}, {}
  for text in line:gmatch("([^*]*)%*") do
    texts[#texts + 1] = text
    figures[#texts] = text:match("^%-?%d[%d.]*$") and text:match("%d$") and tonumber(text) or false
  end
  return figures, texts
end

local function odometer_crc(line)
  local crc = 65535
  for at = 1, #line do
    local byte = line:byte(at)
    for place = 7, 0, -1 do
      local carry = (math.floor(crc / 32768) + math.floor(byte / 2 ^ place)) % 2
      crc = crc * 2 % 65536
      for _, bit in ipairs(carry == 1 and { 4096, 32, 1 } or {}) do
        crc = crc + (math.floor(crc / bit) % 2 == 0 and bit or -bit)
      end
    end
  end
  return crc
end

-- Distance from a positive number to the next one in 32 bits.
local function odometer_unit(number)
  local unit = 2 ^ -23
  while unit * 2 ^ 24 <= number do unit = unit * 2 end
  return unit
end

-- The dialect and the figures; nil if the line does not hold.
local function read_odometer(line)
  if line:sub(1, 1) == "#" then
    local figures = odometer_figures(line:sub(2))
    for at = 1, 10 do
      if not figures[at] then return nil end
    end
    return figures[11] == nil and "raw" or nil, figures
  end
  local figures, texts = odometer_figures(line)
  for at = 1, 4 do
    if not figures[at] then return nil end
  end
  if #texts ~= 5 then return nil end
  if not texts[5]:find(".", 1, true) then
    local covered = line:sub(1, #line - #texts[5] - 1)
    local is_sound = texts[5]:match("^[%dA-F]+$") and texts[5] == string.format("%04X", odometer_crc(covered))
    return is_sound and "fixed" or nil, figures
  end
  if not figures[5] then return nil end
  local is_seed = texts[4]:find(".", 1, true)
  local sum = figures[1] + figures[2] * (is_seed and 1 or 0.0125) + figures[3] + figures[4]
  local allowed = 0.025 + odometer_unit(math.max(math.abs(sum), figures[4]))
  if math.abs(sum - figures[5]) > allowed then return nil end
  return is_seed and "seed" or "as-coded", figures
end

local function judge_odometer(s)
  if not s:find("^[#%d%-]") then return 0 end
  local at = s:find("[^%dA-F*.#\r%-]")
  if not at then return #s < 160 and nil or 0 end
  if s:sub(at, at) ~= "\n" or at > 160 then return 0 end
  return s:sub(at - 1, at - 1) == "*" and read_odometer(s:sub(1, at - 1)) and at
    or s:sub(at - 2, at - 1) == "*\r" and read_odometer(s:sub(1, at - 2)) and at or 0
end

local function tell_odometer(s)
  local dialect, figures = read_odometer((s:gsub("[\r\n]+$", "")))
  if dialect == "raw" then
    local items = { { f.odo_dialect, dialect }, { f.odo_distance, figures[1] } }
    for at = 2, 10 do items[#items + 1] = { f.odo_figure, figures[at] } end
    return string.format("Odometer %g m", figures[1]), items
  end
  local distance, rate, yaw, time = figures[1], figures[2], figures[3], figures[4]
  if dialect == "fixed" then
    distance, rate, yaw = distance / 1000, rate / 1000, yaw / 1000
  elseif dialect == "seed" then
    yaw = math.rad(yaw)
  end
  time = dialect == "seed" and time or time / 1000
  return string.format("Odometer %.3f m, %.3f rad", distance, yaw), {
    { f.odo_dialect, dialect }, { f.odo_distance, distance }, { f.odo_rate, rate },
    { f.odo_yaw, yaw }, { f.odo_time, time },
  }
end

// The base of the rescue robot as a program for an Arduino Mega: the register protocol on Serial1,
// two wheels with encoders and motor drivers.
//
//   | AB | register | W(7) count | data, only if W | sum of all, low byte first |
//
// A read is answered by a write, a write by an empty read of the same register, a frame whose sum
// is wrong by an empty read of register FF. Motors stop by themselves when the master falls silent for a second.
// Wiring: left power 5, ahead 22, back 23, encoder 18 and 19; right power 6, 24, 25, encoder 2 and
// 3; the battery over 100 : 10 kOhm at A0.
#include <Arduino.h>
#include <avr/wdt.h>

static const uint8_t START = 0xAB, WRITE = 0x80, ERROR_REGISTER = 0xFF;
static const uint8_t REGISTERS = 53;
static const uint8_t BATTERY_MV = 33, BATTERY_PERCENT = 35, ENCODER = 36, SPEED_IS = 44;
static const uint8_t SPEED_TO = 46, STANDBY = 48;
static const unsigned long PERIOD_MS = 40, SILENCE_MS = 1000;
static const int16_t SET_POINT_MAX = 35, SUM_MAX = 200;

static uint8_t registers[REGISTERS];

struct Wheel {
    uint8_t power, ahead, back, a, b;
    volatile int32_t count;
    volatile uint8_t place;
    int32_t before;
    int16_t sum;
};
static Wheel wheels[2] = {{5, 22, 23, 18, 19}, {6, 24, 25, 2, 3}};

// Four edges a cycle; a jump of two is none that can be told.
static void edge(Wheel &wheel) {
    uint8_t a = digitalRead(wheel.a), b = digitalRead(wheel.b);
    uint8_t place = b ? (a ? 2 : 3) : (a ? 1 : 0);
    switch ((uint8_t)(place - wheel.place) & 3) {
    case 1: wheel.count++; break;
    case 3: wheel.count--; break;
    }
    wheel.place = place;
}
static void left_edge() { edge(wheels[0]); }
static void right_edge() { edge(wheels[1]); }

static void drive(Wheel &wheel, int16_t power) {
    digitalWrite(wheel.ahead, power > 0);
    digitalWrite(wheel.back, power < 0);
    analogWrite(wheel.power, min(abs(power), 255));
}

// Proportional and integral, each stronger for a greater set-point.
static void regulate(uint8_t side) {
    Wheel &wheel = wheels[side];
    noInterrupts();
    int32_t count = wheel.count;
    interrupts();
    int16_t is = count - wheel.before;
    wheel.before = count;
    memcpy(registers + ENCODER + 4 * side, &count, 4);
    registers[SPEED_IS + side] = (int8_t)constrain(is, -128, 127);
    int16_t to = constrain((int8_t)registers[SPEED_TO + side], -SET_POINT_MAX, SET_POINT_MAX);
    if (to == 0 || registers[STANDBY] != 0) {
        wheel.sum = 0;
        drive(wheel, 0);
        return;
    }
    int16_t error = to - is;
    if (abs(wheel.sum + error) < SUM_MAX)
        wheel.sum += error;
    int16_t gain = max(abs(to) / 3, 2);
    int16_t power = constrain(error * gain + wheel.sum * (abs(to) / 10 + 1), -255, 255);
    drive(wheel, power == 0 ? 0 : power * 21 / 25 + (power > 0 ? 40 : -40));
}

static void put(const uint8_t *bytes, uint8_t len) {
    uint16_t sum = 0;
    for (uint8_t i = 0; i < len; i++)
        sum += bytes[i];
    Serial1.write(bytes, len);
    Serial1.write(sum & 0xFF);
    Serial1.write(sum >> 8);
}

static void answer(const uint8_t *frame) {
    uint8_t first = frame[1], count = frame[2] & ~WRITE;
    uint8_t reply[3 + 127] = {START, first, 0};
    if (frame[2] & WRITE) {
        for (uint8_t i = 0; i < count && first + i < REGISTERS; i++)
            registers[first + i] = frame[3 + i];
        put(reply, 3);
        return;
    }
    reply[2] = WRITE | count;
    for (uint8_t i = 0; i < count; i++)
        reply[3 + i] = first + i < REGISTERS ? registers[first + i] : 0;
    put(reply, 3 + count);
}

static uint8_t frame[132];
static uint8_t have = 0;
static unsigned long heard_ms = 0, byte_ms = 0;

// A rejected frame costs its first byte; what follows may begin another one.
static void drop_one() {
    do {
        memmove(frame, frame + 1, --have);
    } while (have > 0 && frame[0] != START);
}

static void look() {
    while (have >= 3) {
        uint8_t len = 3 + (frame[2] & WRITE ? frame[2] & ~WRITE : 0);
        if (have < len + 2)
            return;
        uint16_t sum = 0;
        for (uint8_t i = 0; i < len; i++)
            sum += frame[i];
        if (frame[len] != (sum & 0xFF) || frame[len + 1] != sum >> 8) {
            const uint8_t error[3] = {START, ERROR_REGISTER, 0};
            put(error, 3);
            drop_one();
            continue;
        }
        heard_ms = millis();
        answer(frame);
        have -= len + 2;
        memmove(frame, frame + len + 2, have);
        while (have > 0 && frame[0] != START)
            drop_one();
    }
}

void setup() {
    wdt_enable(WDTO_500MS);
    Serial.begin(115200);
    Serial1.begin(1000000);
    for (uint8_t side = 0; side < 2; side++) {
        pinMode(wheels[side].power, OUTPUT);
        pinMode(wheels[side].ahead, OUTPUT);
        pinMode(wheels[side].back, OUTPUT);
        pinMode(wheels[side].a, INPUT);
        pinMode(wheels[side].b, INPUT);
        edge(wheels[side]);
        wheels[side].count = 0;
    }
    attachInterrupt(digitalPinToInterrupt(18), left_edge, CHANGE);
    attachInterrupt(digitalPinToInterrupt(19), left_edge, CHANGE);
    attachInterrupt(digitalPinToInterrupt(2), right_edge, CHANGE);
    attachInterrupt(digitalPinToInterrupt(3), right_edge, CHANGE);
    Serial.println("base: ready");
}

static unsigned long regulated_ms = 0;

void loop() {
    wdt_reset();
    unsigned long now = millis();
    while (Serial1.available() && have < sizeof frame) {
        uint8_t byte = Serial1.read();
        byte_ms = now;
        if (have == 0 && byte != START)
            continue;
        frame[have++] = byte;
        look();
    }
    if (have > 0 && now - byte_ms > 5)
        have = 0;
    if (now - heard_ms > SILENCE_MS)
        registers[SPEED_TO] = registers[SPEED_TO + 1] = 0;
    if (now - regulated_ms >= PERIOD_MS) {
        regulated_ms += PERIOD_MS;
        regulate(0);
        regulate(1);
        uint16_t mv = (uint32_t)analogRead(0) * 5000 / 1024 * 11;
        memcpy(registers + BATTERY_MV, &mv, 2);
        registers[BATTERY_PERCENT] = constrain(((int32_t)mv - 6400) / 20, 0, 100);
    }
}

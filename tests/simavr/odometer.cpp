// A sketch for the MEGA2560 of a model car, written anew after the published facts of its own: an
// encoder on pins 6 and 7, which have no interrupts there, and the gyroscope of an MPU-6050. A line
// each 10 ms: distance * rate * heading * time * sum *
#include <Arduino.h>
#include <Wire.h>

static const uint8_t SENSOR = 0x68;
static const uint8_t PIN_A = 6, PIN_B = 7;
static const float COUNT_M = 0.003351;
static const float RATE_UNIT_DPS = 0.060975;

static long counted = 0;
static uint8_t position = 0;
static float offset = 0.0, heading = 0.0;

static void write_register(uint8_t number, uint8_t value) {
    Wire.beginTransmission(SENSOR);
    Wire.write(number);
    Wire.write(value);
    Wire.endTransmission();
}

static bool select_register(uint8_t number) {
    Wire.beginTransmission(SENSOR);
    Wire.write(number);
    return Wire.endTransmission() == 0;
}

static int16_t turn_rate() {
    select_register(0x47);
    Wire.requestFrom(SENSOR, (uint8_t)2);
    uint8_t high = Wire.read();
    return (int16_t)((uint16_t)high << 8 | (uint8_t)Wire.read());
}

// Where in its cycle of four edges the encoder is: 00, 10, 11, 01 as B A.
static uint8_t look() {
    uint8_t a = digitalRead(PIN_A), b = digitalRead(PIN_B);
    return b ? (a ? 2 : 1) : (a ? 3 : 0);
}

// Two edges at once are taken for two of pin A.
static void count() {
    uint8_t now = look();
    switch ((uint8_t)(now - position) & 3) {
    case 1: counted += 1; break;
    case 2: counted += position & 1 ? -2 : 2; break;
    case 3: counted -= 1; break;
    }
    position = now;
}

void setup() {
    Serial.begin(115200);
    Wire.begin();
    Wire.setClock(400000);
    pinMode(PIN_A, INPUT);
    pinMode(PIN_B, INPUT);
    while (true) {
        if (select_register(0x75) && Wire.requestFrom(SENSOR, (uint8_t)1) == 1 &&
            Wire.read() == 0x68)
            break;
        Serial.println("Could not find a valid MPU6050 sensor, check wiring!");
        delay(500);
    }
    write_register(0x6B, 0x00);
    write_register(0x1B, 0x18);
    float sum = 0;
    for (uint8_t sample = 0; sample < 50; sample++) {
        sum += turn_rate();
        delay(5);
    }
    offset = sum / 50;
    while (millis() < 265) {
    }
    position = look();
}

void loop() {
    unsigned long began = millis();
    count();
    float raw = turn_rate();
    heading += (raw - offset) * RATE_UNIT_DPS * (PI / 180) * 0.01;
    float distance = counted * COUNT_M;
    float rate = raw * (PI / 180) * 25 / 2000;
    unsigned long now = millis();
    // As the car's own: the rate is scaled a second time.
    float sum = distance + rate * 25 / 2000 + heading + now;
    Serial.print(distance);
    Serial.print("*");
    Serial.print(rate);
    Serial.print("*");
    Serial.print(heading);
    Serial.print("*");
    Serial.print(now);
    Serial.print("*");
    Serial.print(sum);
    Serial.println("*");
    delay(10 - (millis() - began));
}

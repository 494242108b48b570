// Reads a TFmini range finder on Serial1: frames 59 59, distance, strength, mode, 0, sum.
#include <Arduino.h>

static uint8_t frame[9];
static uint8_t have = 0;
static uint16_t frames = 0;

void setup() {
    Serial.begin(115200);
    Serial1.begin(115200);
}

void loop() {
    if (!Serial1.available())
        return;
    frame[have++] = Serial1.read();
    if (have <= 2 && frame[have - 1] != 0x59)
        have = 0;
    if (have < sizeof frame)
        return;
    have = 0;
    uint8_t sum = 0;
    for (uint8_t i = 0; i < 8; i++)
        sum += frame[i];
    if (sum != frame[8]) {
        Serial.println("bad sum");
        return;
    }
    if (++frames % 50 == 0) {
        Serial.print("cm ");
        Serial.print(frame[2] | frame[3] << 8);
        Serial.print(" strength ");
        Serial.println(frame[4] | frame[5] << 8);
    }
}

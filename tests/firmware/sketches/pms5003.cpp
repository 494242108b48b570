// Reads a PMS5003 on Serial1: frames 42 4D, length, thirteen words, sum.
#include <Arduino.h>

static uint8_t frame[32];
static uint8_t have = 0;

void setup() {
    Serial.begin(115200);
    Serial1.begin(9600);
}

void loop() {
    if (!Serial1.available())
        return;
    frame[have++] = Serial1.read();
    if ((have == 1 && frame[0] != 0x42) || (have == 2 && frame[1] != 0x4D))
        have = 0;
    if (have < sizeof frame)
        return;
    have = 0;
    uint16_t sum = 0;
    for (uint8_t i = 0; i < 30; i++)
        sum += frame[i];
    if (sum != (frame[30] << 8 | frame[31])) {
        Serial.println("bad sum");
        return;
    }
    Serial.print("pm2.5 ");
    Serial.println(frame[12] << 8 | frame[13]);
}

// Asks an MH-Z19 on Serial1 for the concentration of CO2.
#include <Arduino.h>

static uint8_t check(const uint8_t *frame) {
    uint8_t sum = 0;
    for (uint8_t i = 1; i < 8; i++)
        sum += frame[i];
    return 0xFF - sum + 1;
}

void setup() {
    Serial.begin(115200);
    Serial1.begin(9600);
    Serial1.setTimeout(200);
}

void loop() {
    uint8_t frame[9] = {0xFF, 0x01, 0x86};
    frame[8] = check(frame);
    Serial1.write(frame, sizeof frame);
    bool sound = Serial1.readBytes(frame, sizeof frame) == sizeof frame && frame[1] == 0x86;
    if (sound && frame[8] == check(frame)) {
        Serial.print("ppm ");
        Serial.println(frame[2] << 8 | frame[3]);
    } else {
        Serial.println("no answer");
    }
    delay(2000);
}

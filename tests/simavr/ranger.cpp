// A sketch that ranges with an SRF08 at 0xE0, in turn over 6 m and over 1 m. A line a range: what
// the range register was set to, centimetres, milliseconds until the chip answered again.
#include <Arduino.h>
#include <Wire.h>

static const uint8_t RANGER = 0xE0 >> 1;

static void write_register(uint8_t number, uint8_t value) {
    Wire.beginTransmission(RANGER);
    Wire.write(number);
    Wire.write(value);
    Wire.endTransmission();
}

static bool is_there() {
    Wire.beginTransmission(RANGER);
    Wire.write((uint8_t)0);
    return Wire.endTransmission() == 0;
}

static void range(uint8_t reach) {
    write_register(2, reach);
    write_register(0, 0x51);
    unsigned long began = millis();
    while (!is_there()) {
    }
    unsigned long took = millis() - began;
    Wire.beginTransmission(RANGER);
    Wire.write((uint8_t)2);
    Wire.endTransmission();
    Wire.requestFrom(RANGER, (uint8_t)2);
    uint8_t high = Wire.read();
    unsigned centimetres = (unsigned)high << 8 | (uint8_t)Wire.read();
    Serial.print(reach);
    Serial.print(" ");
    Serial.print(centimetres);
    Serial.print(" ");
    Serial.println(took);
}

void setup() {
    Serial.begin(115200);
    Wire.begin();
}

void loop() {
    range(140);
    range(24);
}

// A weather station of a robot's workshop, for a board with two UARTs: an SRF08 and an MPU-6050 on
// I2C, a balance on Serial1, a report each second on Serial2. It counts its starts in the EEPROM,
// and its watchdog starts it again when it hangs, which it does once, 20 s after its first start.
#include <Arduino.h>
#include <EEPROM.h>
#include <Wire.h>
#include <avr/wdt.h>

static const uint8_t RANGER = 0x70, SENSOR = 0x68;
static uint8_t cause __attribute__((section(".noinit")));
static uint8_t starts = 0;

void keep_cause() __attribute__((naked, used, section(".init3")));
void keep_cause() {
    cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

static bool put(uint8_t chip, uint8_t number, uint8_t value) {
    Wire.beginTransmission(chip);
    Wire.write(number);
    Wire.write(value);
    return Wire.endTransmission() == 0;
}

// A word, high byte first; -1 without an answer.
static long get(uint8_t chip, uint8_t number) {
    Wire.beginTransmission(chip);
    Wire.write(number);
    if (Wire.endTransmission() != 0 || Wire.requestFrom(chip, (uint8_t)2) != 2)
        return -1;
    uint8_t high = Wire.read();
    return (uint16_t)high << 8 | (uint8_t)Wire.read();
}

static void report(const char *what, long value) {
    Serial2.print(what);
    Serial2.print('=');
    Serial2.println(value);
    // The console is a copy of it.
    Serial.print(what);
    Serial.print('=');
    Serial.println(value);
}

void setup() {
    wdt_enable(WDTO_1S);
    Serial.begin(115200);
    Serial1.begin(9600);
    Serial2.begin(57600);
    Serial1.setTimeout(300);
    Wire.begin();
    // An EEPROM that was never written reads FF.
    starts = EEPROM.read(10) + 1;
    starts = starts == 0 ? 1 : starts;
    EEPROM.write(10, starts);
    pinMode(LED_BUILTIN, OUTPUT);
    report("start", starts);
    report("cause", cause);
    put(SENSOR, 0x6B, 0x00);
}

static unsigned long next_ms = 0;

void loop() {
    wdt_reset();
    unsigned long now = millis();
    if (now < next_ms)
        return;
    next_ms += 1000;
    digitalWrite(LED_BUILTIN, !digitalRead(LED_BUILTIN));
    // The ranger does not hear while it measures, 65 ms.
    put(RANGER, 0, 0x51);
    delay(70);
    report("cm", get(RANGER, 2));
    report("gyro", get(SENSOR, 0x47));
    report("chip", get(SENSOR, 0x75) >> 8);
    // The balance says its number when it is switched on.
    while (Serial1.available())
        Serial1.read();
    Serial1.print("SI\r\n");
    char line[40];
    size_t len = Serial1.readBytesUntil('\n', line, sizeof line - 1);
    line[len] = 0;
    report("cg", len > 4 ? (long)(atof(line + 4) * 100 + 0.5) : -1);
    if (starts == 1 && now > 20000)
        for (;;) {
        }
}

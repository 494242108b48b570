// A sketch for tests of the simulated board: each command is a letter on Serial, its answer a line.
#include <Arduino.h>
#include <EEPROM.h>
#include <SPI.h>
#include <Wire.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

static uint8_t cause __attribute__((section(".noinit")));

// The flags of the reset are read before the core's start-up needs long: the watchdog still runs.
void keep_cause() __attribute__((naked, used, section(".init3")));
void keep_cause() {
    cause = MCUSR;
    MCUSR = 0;
    wdt_disable();
}

static void say(const char *what, long value) {
    Serial.print(what);
    Serial.print(' ');
    Serial.println(value);
}

void setup() {
    Serial.begin(115200);
    Wire.begin();
    uint8_t boots = EEPROM.read(0) + 1;
    EEPROM.write(0, boots);
    say("cause", cause);
    say("boots", boots);
}

static void transaction() {
    Wire.beginTransmission(0x68);
    Wire.write(0x75);
    say("write", Wire.endTransmission());
    uint8_t count = Wire.requestFrom(0x68, 3);
    say("read", count);
    while (Wire.available())
        say("byte", Wire.read());
    Wire.beginTransmission(0x33);
    say("absent", Wire.endTransmission());
}

void loop() {
    if (!Serial.available())
        return;
    switch (Serial.read()) {
    case 'a': say("volts", analogRead(A1)); break;
    case 'd': say("level", digitalRead(7)); break;
    case 'p': pinMode(9, OUTPUT); analogWrite(9, 64); break;
    case 't':
        pinMode(4, OUTPUT);
        digitalWrite(4, HIGH);
        delayMicroseconds(1500);
        digitalWrite(4, LOW);
        break;
    case 'b': Serial.print("0123456789"); break;
    case 'i': transaction(); break;
    case 'm':
        SPI.begin();
        say("first", SPI.transfer(0x42));
        say("second", SPI.transfer(0x43));
        break;
    case 'o': // Deaf for 1 ms.
        cli();
        _delay_ms(1);
        sei();
        delay(1);
        say("waiting", Serial.available());
        while (Serial.available())
            say("got", Serial.read());
        break;
    case 'w':
        wdt_enable(WDTO_250MS);
        for (;;) {
        }
    case 's': // Until a byte arrives, but for the core's clock.
        TIMSK0 = 0;
        set_sleep_mode(SLEEP_MODE_IDLE);
        sleep_enable();
        while (!Serial.available())
            sleep_cpu();
        sleep_disable();
        TIMSK0 = 1;
        say("woke", Serial.read());
        break;
    case 'x': ((void (*)())0x7000)(); break;
    }
}

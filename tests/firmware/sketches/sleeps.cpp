// The time of EEPROM writes, and what wakes the chip: Timer 1 from idle, the watchdog from power-down,
// but not Timer 1 from power-down.
#include <Arduino.h>
#include <avr/eeprom.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

static volatile bool has_ticked = false, has_barked = false;

ISR(TIMER1_COMPA_vect) { has_ticked = true; }
ISR(WDT_vect) { has_barked = true; }

static unsigned long written_us(uint8_t mode) {
    eeprom_busy_wait();
    unsigned long from = micros();
    cli();
    EEAR = 7;
    EEDR = 42;
    EECR = mode << EEPM0 | 1 << EEMPE;
    EECR |= 1 << EEPE;
    sei();
    eeprom_busy_wait();
    return micros() - from;
}

static void sleep_until(volatile bool &woken, uint8_t mode) {
    set_sleep_mode(mode);
    woken = false;
    while (!woken)
        sleep_mode();
}

void setup() {
    Serial.begin(9600);
    for (uint8_t mode = 0; mode < 3; mode++) {
        Serial.print("written us=");
        Serial.println(written_us(mode));
    }
    // Each 250 ms.
    TCCR1A = 0;
    TCCR1B = 1 << WGM12 | 1 << CS12;
    OCR1A = 15624;
    TIMSK1 = 1 << OCIE1A;
    sleep_until(has_ticked, SLEEP_MODE_IDLE);
    Serial.println("idle: ticked");
    Serial.flush();
    cli();
    MCUSR = 0;
    WDTCSR = 1 << WDCE | 1 << WDE;
    WDTCSR = 1 << WDIE | 1 << WDP2 | 1 << WDP0;
    sei();
    sleep_until(has_barked, SLEEP_MODE_PWR_DOWN);
    wdt_disable();
    Serial.println("power-down: barked");
    Serial.flush();
    sleep_until(has_ticked, SLEEP_MODE_PWR_DOWN);
    Serial.println("power-down: ticked");
}

void loop() {}

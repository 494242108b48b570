// Flags that a program polls and clears by a one: the two-wire bus, the converter, an external
// interrupt.
#include <Arduino.h>

// Starts a step of the bus and waits for its end; the status.
static uint8_t step(uint8_t control) {
    TWCR = _BV(TWINT) | _BV(TWEN) | control;
    while (!(TWCR & _BV(TWINT))) {
    }
    return TWSR & 0xF8;
}

static uint16_t convert(uint8_t input) {
    ADMUX = _BV(REFS0) | input;
    ADCSRA |= _BV(ADSC);
    while (!(ADCSRA & _BV(ADIF))) {
    }
    ADCSRA |= _BV(ADIF);
    return ADC;
}

static void show(const char *name, const uint16_t *values, uint8_t count) {
    Serial.print(name);
    for (uint8_t i = 0; i < count; i++) {
        Serial.print(' ');
        Serial.print(values[i]);
    }
    Serial.println();
}

void setup() {
    Serial.begin(9600);
    TWBR = 72;
    ADCSRA = _BV(ADEN) | 7;
    // INT4 by a falling edge of its pin, which the program drives itself.
    EICRB |= _BV(ISC41);
    pinMode(2, OUTPUT);
    digitalWrite(2, HIGH);
    EIFR = _BV(INTF4);
}

void loop() {
    uint16_t bus[7];
    bus[0] = step(_BV(TWSTA));
    TWDR = 0x68 << 1;
    bus[1] = step(0);
    TWDR = 0x75;
    bus[2] = step(0);
    bus[3] = step(_BV(TWSTA));
    TWDR = 0x68 << 1 | 1;
    bus[4] = step(0);
    bus[5] = step(0);
    bus[6] = TWDR;
    TWCR = _BV(TWINT) | _BV(TWEN) | _BV(TWSTO);
    show("bus", bus, 7);

    // The reference of 1.1 V and ground.
    uint16_t analog[4];
    for (uint8_t i = 0; i < 4; i++)
        analog[i] = convert(i % 2 ? 31 : 30);
    show("analog", analog, 4);

    uint16_t flags[3];
    flags[0] = EIFR & _BV(INTF4);
    digitalWrite(2, LOW);
    flags[1] = EIFR & _BV(INTF4);
    EIFR = _BV(INTF4);
    flags[2] = EIFR & _BV(INTF4);
    digitalWrite(2, HIGH);
    show("flags", flags, 3);
    delay(200);
}

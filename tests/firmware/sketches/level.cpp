// An interrupt at low level whose pin stays low: its routine runs again and again, here 50 times
// until it is switched off, and again when it is switched on.
#include <Arduino.h>

static volatile unsigned long runs = 0;

static void on_low() {
    if (++runs % 50 == 0)
        detachInterrupt(digitalPinToInterrupt(2));
}

void setup() {
    Serial.begin(9600);
    Serial1.begin(9600);
    pinMode(2, INPUT);
}

void loop() {
    attachInterrupt(digitalPinToInterrupt(2), on_low, LOW);
    delay(200);
    Serial.print("runs=");
    Serial.println(runs);
    Serial1.print("SI\r\n");
}

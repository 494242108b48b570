// Weighs with a Mettler Toledo balance on Serial1: SI asks, the answer is a line.
#include <Arduino.h>

void setup() {
    Serial.begin(115200);
    Serial1.begin(9600);
    Serial1.setTimeout(500);
}

void loop() {
    Serial1.print("SI\r\n");
    char line[40];
    size_t len = Serial1.readBytesUntil('\n', line, sizeof line - 1);
    line[len] = 0;
    // "S S     100.25 g", stable; "S D" while it moves.
    if (len > 4 && line[0] == 'S' && (line[2] == 'S' || line[2] == 'D')) {
        Serial.print(line[2] == 'S' ? "stable " : "moving ");
        Serial.println(atof(line + 4));
    }
    delay(1000);
}

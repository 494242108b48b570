// Moves an LX-16A bus servo on Serial1 and reads where it is, as its library does.
#include <Arduino.h>

static const uint8_t ID = 1;

static void send(uint8_t command, const uint8_t *data, uint8_t len) {
    uint8_t sum = ID + len + 3 + command;
    const uint8_t head[5] = {0x55, 0x55, ID, (uint8_t)(len + 3), command};
    Serial1.write(head, sizeof head);
    for (uint8_t i = 0; i < len; i++)
        sum += data[i];
    Serial1.write(data, len);
    Serial1.write((uint8_t)~sum);
    Serial1.flush();
}

// The answer's two data bytes; -1 if none comes within 20 ms.
static long ask(uint8_t command) {
    while (Serial1.available())
        Serial1.read();
    send(command, nullptr, 0);
    Serial1.setTimeout(20);
    uint8_t frame[8];
    if (Serial1.readBytes(frame, sizeof frame) != sizeof frame || frame[4] != command)
        return -1;
    uint8_t sum = 0;
    for (uint8_t i = 2; i < 7; i++)
        sum += frame[i];
    return (uint8_t)~sum == frame[7] ? frame[5] | (long)frame[6] << 8 : -1;
}

static void move(uint16_t to, uint16_t ms) {
    const uint8_t data[4] = {(uint8_t)to, (uint8_t)(to >> 8), (uint8_t)ms, (uint8_t)(ms >> 8)};
    send(1, data, sizeof data);
}

void setup() {
    Serial.begin(115200);
    Serial1.begin(115200);
    const uint8_t on = 1;
    send(31, &on, 1);
}

static uint8_t turn = 0;

void loop() {
    uint16_t to = turn++ % 2 ? 700 : 300;
    move(to, 500);
    delay(1000);
    Serial.print("to ");
    Serial.print(to);
    Serial.print(" at ");
    Serial.print(ask(28));
    Serial.print(" mv ");
    Serial.println(ask(27));
}

// A sketch on the vendor's Arduino library: it collects a turn by the loop of the example
// "simple_connect", prints its points, and starts the scan again: stop and scan, back to back. While
// it prints, the receiver of the board loses bytes. The lidar is at Serial1 of a Mega.
#include <Arduino.h>

#include "RPLidar.cpp"

static const int POINTS_MAX = 400;

static RPLidar lidar;
static uint16_t angles_q6[POINTS_MAX], distances_q2[POINTS_MAX];
static int points = -1;

static void show() {
    Serial.println("turn");
    for (int n = 0; n < points; n++) {
        Serial.print(angles_q6[n]);
        Serial.print(' ');
        Serial.println(distances_q2[n]);
    }
    Serial.println("turn");
}

static void begin() {
    points = -1;
    while (Serial1.read() >= 0) {
    }
    lidar.startScan();
}

void setup() {
    Serial.begin(1000000);
    lidar.begin(Serial1);
}

void loop() {
    if (!IS_OK(lidar.waitPoint())) {
        rplidar_response_device_info_t info;
        if (IS_OK(lidar.getDeviceInfo(info, 100))) {
            Serial.println("found");
            begin();
        }
        return;
    }
    RPLidarMeasurement point = lidar.getCurrentPoint();
    if (point.startBit && points > 0) {
        show();
        begin();
        return;
    }
    if (point.startBit)
        points = 0;
    if (points >= 0 && points < POINTS_MAX) {
        angles_q6[points] = (uint16_t)(point.angle * 64);
        distances_q2[points++] = (uint16_t)(point.distance * 4);
    }
}

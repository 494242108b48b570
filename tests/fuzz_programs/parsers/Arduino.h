/* What TinyGPS++ needs of Arduino's core on a PC. */
#pragma once
#include <chrono>
#include <math.h>
#include <stdint.h>

typedef uint8_t byte;
#define PI 3.1415926535897932384626433832795
#define TWO_PI (2 * PI)
#define radians(deg) ((deg) * PI / 180)
#define degrees(rad) ((rad) * 180 / PI)
#define sq(x) ((x) * (x))
unsigned long millis();

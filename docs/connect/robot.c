/* Drives until the wall ahead is 75 cm away, and stops. */
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

static int open_port(const char *path) {
    int fd = open(path, O_RDWR | O_NOCTTY);
    struct termios line;
    tcgetattr(fd, &line);
    cfmakeraw(&line);
    cfsetspeed(&line, B115200);
    tcsetattr(fd, TCSANOW, &line);
    return fd;
}

static void drive(int wheels, uint8_t speed) {
    uint8_t frame[7] = {0xAB, 1, 0x80 | 2, speed, speed}, answer[5];
    uint16_t sum = 0;
    for (int i = 0; i < 5; i++) sum += frame[i];
    frame[5] = sum & 0xFF, frame[6] = sum >> 8;
    if (write(wheels, frame, 7) != 7) exit(1);
    for (ssize_t got = 0; got < 5;) got += read(wheels, answer + got, 5 - got);
}

static int ahead_mm(int lidar) { /* index 90 looks ahead: packet 22, third reading */
    static uint8_t p[22];
    for (;;) {
        for (int i = 0; i < 21; i++) p[i] = p[i + 1];
        if (read(lidar, &p[21], 1) != 1) exit(1);
        uint32_t sum = 0;
        for (int i = 0; i < 20; i += 2) sum = (sum << 1) + (p[i] | p[i + 1] << 8);
        int is_sound = (((sum & 0x7FFF) + (sum >> 15)) & 0x7FFF) == (uint32_t)(p[20] | p[21] << 8);
        if (p[0] == 0xFA && p[1] == 0xB6 && is_sound && !(p[13] & 0x80))
            return p[12] | (p[13] & 0x3F) << 8;
    }
}

int main(void) {
    int lidar = open_port(getenv("HILRIG_PORT_LIDAR"));
    int wheels = open_port(getenv("HILRIG_PORT_WHEELS"));
    for (;;) drive(wheels, ahead_mm(lidar) > 750 ? 25 : 0);
}

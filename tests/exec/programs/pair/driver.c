/* Takes orders from a planner, confirms the sound ones, and drives the wheels. */
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

static int port(const char *path) {
    int fd = open(path, O_RDWR | O_NOCTTY);
    struct termios settings;
    if (fd < 0 || tcgetattr(fd, &settings) < 0) {
        perror(path);
        _exit(1);
    }
    cfmakeraw(&settings);
    cfsetspeed(&settings, B115200);
    tcsetattr(fd, TCSANOW, &settings);
    return fd;
}

static unsigned sum(const char *text, const char *end) {
    unsigned all = 0;
    while (text < end)
        all += (unsigned char)*text++;
    return all & 0xFF;
}

static void obey(int orders, int wheels, const char *line) {
    const char *star = strrchr(line, '*');
    unsigned said, number;
    int speed, len;
    char out[64];
    if (!star || sscanf(star, "*%2X", &said) != 1 || said != sum(line, star) ||
        sscanf(line, "G %u %d*", &number, &speed) != 2)
        return;
    len = snprintf(out, sizeof out, "V %d %d\n", speed, speed);
    write(wheels, out, len);
    len = snprintf(out, sizeof out, "A %u", number);
    len += snprintf(out + len, sizeof out - len, "*%02X\n", sum(out, out + len));
    write(orders, out, len);
}

int main(int count, char **paths) {
    if (count < 3)
        return 2;
    int orders = port(paths[1]), wheels = port(paths[2]);
    char line[64];
    unsigned fill = 0;
    for (;;) {
        struct pollfd both[2] = {{orders, POLLIN, 0}, {wheels, POLLIN, 0}};
        char buf[256];
        poll(both, 2, -1);
        if (both[1].revents & POLLIN)
            read(wheels, buf, sizeof buf);
        if (!(both[0].revents & POLLIN))
            continue;
        long len = read(orders, buf, sizeof buf);
        for (long i = 0; i < len; i++) {
            if (buf[i] == '\n') {
                line[fill] = 0;
                fill = 0;
                obey(orders, wheels, line);
            } else if (fill < sizeof line - 1) {
                line[fill++] = buf[i];
            }
        }
    }
}

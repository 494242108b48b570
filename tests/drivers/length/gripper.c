/* A gripper's number, asked for each 50 ms.
 * Frames: AB, register, count (bit 7: with data), data, byte sum low byte first.
 * Defect: the count of an answer is believed, whatever was asked. A damaged one lets the parser wait
 * for bytes that never come and eat the answers behind it. */
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

static unsigned char held[256];
static int len;

static int sound(const unsigned char *f, int n)
{
    unsigned sum = 0;
    for (int i = 0; i < n - 2; i++) sum += f[i];
    return f[n - 2] == (sum & 255) && f[n - 1] == (sum >> 8 & 255);
}

static void drop(int n) { memmove(held, held + n, len -= n); }

/* The number, or -1 after 100 ms without. */
static long number(int fd, int trusts)
{
    unsigned char ask[5] = {0xAB, 0, 4, 0xAF, 0};
    write(fd, ask, 5);
    for (;;) {
        while (len >= 3) {
            int n = held[2] & 127;
            if (held[0] != 0xAB || (!trusts && n != 4)) { drop(1); continue; }
            if (len < n + 5) break;
            if (!sound(held, n + 5)) { drop(1); continue; }
            long v = held[3] | held[4] << 8 | held[5] << 16 | (long)held[6] << 24;
            drop(n + 5);
            return v;
        }
        struct pollfd p = {fd, POLLIN, 0};
        if (poll(&p, 1, 100) <= 0) return -1;
        len += read(fd, held + len, sizeof held - len);
    }
}

int main(int argc, char **argv)
{
    int fd = open(getenv("HILRIG_PORT_GRIP"), O_RDWR | O_NOCTTY);
    struct termios t;
    if (fd < 0 || tcgetattr(fd, &t)) return 2;
    cfmakeraw(&t);
    cfsetspeed(&t, B115200);
    tcsetattr(fd, TCSANOW, &t);
    for (int missed = 0;; usleep(50000)) {
        long v = number(fd, argc > 1 && !strcmp(argv[1], "broken"));
        missed = v < 0 ? missed + 1 : 0;
        printf("number %ld\n", v), fflush(stdout);
        if (missed == 3) { fprintf(stderr, "no answer three times\n"); return 3; }
    }
}

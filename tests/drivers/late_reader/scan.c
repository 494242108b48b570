/* Counts the packets of a range finder and misses none.
 * Defect: it loads its settings for 1.5 s between opening the port and reading it. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

int main(int argc, char **argv)
{
    int broken = argc > 1 && !strcmp(argv[1], "broken");
    if (!broken) usleep(1500000);
    int fd = open(getenv("HILRIG_PORT_LIDAR"), O_RDWR | O_NOCTTY);
    struct termios t;
    if (fd < 0 || tcgetattr(fd, &t)) return 2;
    cfmakeraw(&t);
    cfsetspeed(&t, B115200);
    tcsetattr(fd, TCSANOW, &t);
    if (broken) usleep(1500000);
    unsigned char held[22];
    int len = 0, last = -1, packets = 0;
    for (;;) {
        int got = read(fd, held + len, sizeof held - len);
        if (got <= 0) return 2;
        len += got;
        while (len && (held[0] != 0xFA || (len > 1 && (held[1] < 0xA0 || held[1] > 0xF9))))
            memmove(held, held + 1, --len);
        if (len < 22) continue;
        int index = held[1] - 0xA0;
        if (last >= 0 && index != (last + 1) % 90) {
            fprintf(stderr, "packets between %d and %d are missing\n", last, index);
            return 1;
        }
        last = index;
        len = 0;
        if (++packets % 90 == 0) printf("%d packets\n", packets), fflush(stdout);
    }
}

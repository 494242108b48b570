/* Sets a gripper and reads it back.
 * Defect: the port is left as a terminal for people: a read ends at a line feed, CR becomes LF. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

int main(int argc, char **argv)
{
    int broken = argc > 1 && !strcmp(argv[1], "broken");
    int fd = open(getenv("HILRIG_PORT_GRIP"), O_RDWR | O_NOCTTY);
    struct termios t;
    if (fd < 0 || tcgetattr(fd, &t)) return 2;
    cfmakeraw(&t);
    t.c_cc[VMIN] = 0;
    t.c_cc[VTIME] = 2;
    if (broken) t.c_iflag |= ICRNL, t.c_lflag |= ICANON;
    cfsetspeed(&t, B115200);
    tcsetattr(fd, TCSANOW, &t);
    for (int n = 0;; n++, usleep(100000)) {
        unsigned char ask[5] = {0xAB, 0, 1, 0xAC, 0}, got[6];
        int len = 0, part;
        write(fd, ask, 5);
        while (len < 6 && (part = read(fd, got + len, 6 - len)) > 0) len += part;
        printf("%d: %d bytes, force %d\n", n, len, len == 6 ? got[3] : -1), fflush(stdout);
    }
}

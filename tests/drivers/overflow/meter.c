/* Lines of a meter, each kept in a struct of fixed size.
 * Defect: a line that lost its end runs into the next ones, and the length is not looked at: it
 * grows over the pointer behind it. */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <unistd.h>

struct row {
    char text[32];
    const char *unit;
};

int main(int argc, char **argv)
{
    int broken = argc > 1 && !strcmp(argv[1], "broken");
    int fd = open(getenv("HILRIG_PORT_METER"), O_RDWR | O_NOCTTY);
    struct termios t;
    if (fd < 0 || tcgetattr(fd, &t)) return 2;
    cfmakeraw(&t);
    cfsetspeed(&t, B9600);
    tcsetattr(fd, TCSANOW, &t);
    volatile struct row row = {"", "W"};
    volatile char *text = row.text;
    size_t len = 0;
    char c;
    while (read(fd, &c, 1) == 1) {
        if (c != '\r') {
            if (broken || len < sizeof row.text - 1) text[len++] = c;
            continue;
        }
        text[len] = 0;
        printf("%s %s\n", (const char *)row.text, row.unit), fflush(stdout);
        len = 0;
    }
}

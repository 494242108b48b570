#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>
int main(void) {
    int fd = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY | O_NONBLOCK);
    int timeouts = 0, bytes = 0, n;
    char buf[64];
    struct timespec t;
    do {
        struct pollfd p = {fd, POLLIN, 0};
        if (poll(&p, 1, 30) == 0)
            timeouts++;
        else if ((n = read(fd, buf, 64)) > 0)
            bytes += n;
        clock_gettime(CLOCK_MONOTONIC, &t);
    } while (t.tv_sec < 1002);
    printf("%d timeouts, %d lines\n", timeouts, bytes / 8);
    fflush(stdout);
    sleep(60);
}

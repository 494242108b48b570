/* A control loop of 100 ms that plans a path in each cycle, and gives up at a missed deadline. */
#include <fcntl.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static volatile unsigned plan;

int main(void) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    char bytes[64];
    if (read(port, bytes, sizeof bytes) <= 0) return 2;
    struct timespec next;
    clock_gettime(CLOCK_MONOTONIC, &next);
    for (;;) {
        if (read(port, bytes, sizeof bytes) <= 0) return 2;
        for (unsigned step = 0; step < 2000000; step++) plan = plan * 1664525 + step;
        if (write(port, "ping\r\n", 6) != 6) return 3;
        next.tv_nsec += 100000000;
        if (next.tv_nsec >= 1000000000) {
            next.tv_nsec -= 1000000000;
            next.tv_sec++;
        }
        struct timespec now;
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (now.tv_sec > next.tv_sec || (now.tv_sec == next.tv_sec && now.tv_nsec > next.tv_nsec)) return 7;
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    }
}

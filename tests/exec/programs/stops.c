// Looks at the clock again and again by a system call, which stops; with an argument on another
// processor than its supervisor.
#define _GNU_SOURCE
#include <fcntl.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>
int main(int count, char **words) {
    (void)words;
    open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    if (count > 1) {
        cpu_set_t other;
        CPU_ZERO(&other);
        CPU_SET((sched_getcpu() + 1) % sysconf(_SC_NPROCESSORS_ONLN), &other);
        if (sched_setaffinity(0, sizeof other, &other)) return 1;
    }
    struct timespec t;
    for (int i = 0; i < 200000; i++)
        syscall(SYS_clock_gettime, CLOCK_MONOTONIC, &t);
    return 0;
}

/* Two threads wait in loops without a call: for a signal, and for a third thread that sleeps. */
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

static volatile int flag, alarmed;
static volatile long counted;

static void on_alarm(int number) { alarmed = number; }

/* Once more than is waited for, so that nothing computes afterwards. */
enum { CHANGES = 4 };

static void *setter(void *none) {
    for (int change = 0; change < CHANGES; change++) {
        struct timespec pause = {0, 200000000};
        nanosleep(&pause, NULL);
        flag++;
    }
    return none;
}

static void *follower(void *none) {
    while (flag < CHANGES) {
        int seen = flag;
        while (flag == seen);
    }
    return none;
}

int main(int count, char **words) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    char bytes[64];
    if (read(port, bytes, sizeof bytes) <= 0) return 2;
    signal(SIGALRM, on_alarm);
    struct itimerval later = {{0, 0}, {0, 150000}};
    setitimer(ITIMER_REAL, &later, NULL);
    /* A loop that counts is no wait. */
    while (!alarmed)
        if (count > 1 && !strcmp(words[1], "counts")) counted++;
    pthread_t thread;
    /* All memory is compared each time: little of it. */
    pthread_attr_t small;
    pthread_attr_init(&small);
    pthread_attr_setstacksize(&small, 65536);
    pthread_create(&thread, &small, setter, NULL);
    pthread_create(&thread, &small, follower, NULL);
    for (int round = 0; round < 3; round++) {
        int seen = flag;
        while (flag == seen);
        if (write(port, "ping\r\n", 6) != 6) return 3;
        dprintf(1, "round %d\n", round);
    }
    for (;;)
        if (read(port, bytes, sizeof bytes) <= 0) return 2;
}

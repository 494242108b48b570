/* Two threads count without a lock: an addition may get lost. */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static volatile long total;

static void *worker(void *none) {
    (void)none;
    struct timespec pause = {0, 10000000};
    for (int round = 0; round < 50; round++) {
        for (int i = 0; i < 100; i++) total = total + 1;
        nanosleep(&pause, NULL);
    }
    return NULL;
}

int main(void) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    pthread_t threads[2];
    for (int i = 0; i < 2; i++) pthread_create(&threads[i], NULL, worker, NULL);
    for (int i = 0; i < 2; i++) pthread_join(threads[i], NULL);
    if (total != 10000) return 7;
    for (;;) {
        char bytes[64];
        if (read(port, bytes, sizeof bytes) < 0 || write(1, "read\n", 5) != 5) return 3;
    }
}

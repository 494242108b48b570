/* Two numbers that belong together are written one after the other, and read without a lock. */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static volatile int first, second, is_torn;

static void pause_for(long nanos) {
    struct timespec pause = {0, nanos};
    nanosleep(&pause, NULL);
}

static void *writer(void *none) {
    (void)none;
    for (int round = 1; round <= 50; round++) {
        for (int i = 0; i < 50; i++) {
            first = round * 100 + i;
            second = round * 100 + i;
        }
        pause_for(10000000);
    }
    return NULL;
}

static void *reader(void *none) {
    (void)none;
    for (int round = 1; round <= 50; round++) {
        if (first != second) is_torn = 1;
        pause_for(10000000);
    }
    return NULL;
}

int main(void) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    pthread_t threads[2];
    pthread_create(&threads[0], NULL, writer, NULL);
    pthread_create(&threads[1], NULL, reader, NULL);
    for (int i = 0; i < 2; i++) pthread_join(threads[i], NULL);
    if (is_torn) return 7;
    for (;;) {
        char bytes[64];
        if (read(port, bytes, sizeof bytes) < 0 || write(1, "read\n", 5) != 5) return 3;
    }
}

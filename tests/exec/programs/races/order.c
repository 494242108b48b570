/* A thread takes the order that its starter writes after it has started the thread. */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <unistd.h>

static volatile int order;

static void *worker(void *none) {
    (void)none;
    return order == 0 ? NULL : (void *)&order;
}

int main(void) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    for (int round = 0; round < 20; round++) {
        pthread_t thread;
        void *taken = NULL;
        order = 0;
        pthread_create(&thread, NULL, worker, NULL);
        order = round + 1;
        pthread_join(thread, &taken);
        if (taken == NULL) return 7;
    }
    for (;;) {
        char bytes[64];
        if (read(port, bytes, sizeof bytes) < 0 || write(1, "read\n", 5) != 5) return 3;
    }
}

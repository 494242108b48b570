/* A flag is set and signalled without the lock: the waiter may miss it and sleep for ever. */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t changed = PTHREAD_COND_INITIALIZER;
static volatile int is_ready;

static void *producer(void *none) {
    (void)none;
    struct timespec pause = {0, 20000000};
    nanosleep(&pause, NULL);
    is_ready = 1;
    pthread_cond_signal(&changed);
    return NULL;
}

int main(void) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    pthread_t thread;
    pthread_create(&thread, NULL, producer, NULL);
    struct timespec pause = {0, 20000000};
    nanosleep(&pause, NULL);
    pthread_mutex_lock(&lock);
    while (!is_ready) {
        struct timespec step = {0, 1000};
        nanosleep(&step, NULL);
        if (is_ready) break;
        pthread_cond_wait(&changed, &lock);
    }
    pthread_mutex_unlock(&lock);
    for (;;) {
        char bytes[64];
        if (read(port, bytes, sizeof bytes) < 0 || write(1, "read\n", 5) != 5) return 3;
    }
}

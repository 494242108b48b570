/* Two threads each make the table if it is not there: checked and made in two steps. */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

static int *volatile table;
static volatile int made;

static int *the_table(void) {
    if (table == NULL) {
        int *new = calloc(16, sizeof *new);
        made = made + 1;
        table = new;
    }
    return table;
}

static void *worker(void *none) {
    (void)none;
    struct timespec pause = {0, 20000000};
    nanosleep(&pause, NULL);
    the_table()[1]++;
    return NULL;
}

int main(void) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    pthread_t threads[2];
    for (int i = 0; i < 2; i++) pthread_create(&threads[i], NULL, worker, NULL);
    for (int i = 0; i < 2; i++) pthread_join(threads[i], NULL);
    if (made != 1) return 7;
    for (;;) {
        char bytes[64];
        if (read(port, bytes, sizeof bytes) < 0 || write(1, "read\n", 5) != 5) return 3;
    }
}

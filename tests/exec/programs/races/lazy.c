/* Two threads each make a table if it is not there: it is looked for and made in two steps. */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

enum { ROUNDS = 40 };

static int *volatile tables[ROUNDS];
static volatile int made;

static int *the_table(int round) {
    if (tables[round] == NULL) {
        int *table = calloc(16, sizeof *table);
        made = made + 1;
        tables[round] = table;
    }
    return tables[round];
}

static void *worker(void *none) {
    (void)none;
    for (int round = 0; round < ROUNDS; round++) {
        struct timespec pause = {0, 20000000};
        nanosleep(&pause, NULL);
        the_table(round)[1]++;
    }
    return NULL;
}

int main(void) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    pthread_t threads[2];
    for (int i = 0; i < 2; i++) pthread_create(&threads[i], NULL, worker, NULL);
    for (int i = 0; i < 2; i++) pthread_join(threads[i], NULL);
    if (made != ROUNDS) return 7;
    for (;;) {
        char bytes[64];
        if (read(port, bytes, sizeof bytes) < 0 || write(1, "read\n", 5) != 5) return 3;
    }
}

/* The reader uses the settings that the main thread makes after it has started the reader. */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <unistd.h>

static int *volatile settings;
static int values[4] = {1, 2, 3, 4};
static int port;

static void *reader(void *none) {
    (void)none;
    for (;;) {
        char bytes[64];
        if (read(port, bytes, sizeof bytes) < 0 || write(1, "read\n", 5) != 5) exit(3);
        if (settings[0] != 1) exit(4);
    }
}

static void *other(void *none) {
    (void)none;
    return settings;
}

int main(void) {
    port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    pthread_t thread, second;
    pthread_create(&thread, NULL, other, NULL);
    settings = values;
    void *seen = NULL;
    pthread_join(thread, &seen);
    if (seen == NULL) return 7;
    pthread_create(&second, NULL, reader, NULL);
    pthread_join(second, NULL);
}

/* A thread that waits outside of virtual time, and a child with memory of its own: both call a
   function at which a debugger has set a breakpoint. */
#define _GNU_SOURCE
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static volatile int marks[3];
static int locked;

static void mark(int who) { marks[who]++; }

static void nap(long ms) {
    struct timespec pause = {ms / 1000, ms % 1000 * 1000000};
    nanosleep(&pause, NULL);
}

static void *outside(void *none) {
    struct flock all = {.l_type = F_WRLCK};
    fcntl(locked, F_OFD_SETLKW, &all);
    mark(1);
    dprintf(1, "outside %d\n", marks[1]);
    return none;
}

int main(void) {
    struct flock all = {.l_type = F_WRLCK};
    FILE *file = tmpfile();
    char again[32];
    pthread_t thread;
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY), status = 0;
    snprintf(again, sizeof again, "/proc/self/fd/%d", fileno(file));
    locked = open(again, O_RDWR);
    fcntl(fileno(file), F_OFD_SETLKW, &all);
    /* As `fork`, but by the call of threads. */
    long child = syscall(SYS_clone, SIGCHLD, 0, 0, 0, 0);
    if (child == 0) {
        nap(1500);
        mark(2);
        _exit(10 + marks[2]);
    }
    pthread_create(&thread, NULL, outside, NULL);
    for (int beat = 0; beat < 20; beat++) {
        nap(100);
        if (write(port, "ping\r\n", 6) != 6) return 3;
    }
    all.l_type = F_UNLCK;
    fcntl(fileno(file), F_OFD_SETLKW, &all);
    pthread_join(thread, NULL);
    waitpid((pid_t)child, &status, 0);
    dprintf(1, "child %d, ended %d\n", WEXITSTATUS(status), WIFEXITED(status));
    for (;;) {
        char bytes[64];
        if (read(port, bytes, sizeof bytes) <= 0) return 2;
    }
}

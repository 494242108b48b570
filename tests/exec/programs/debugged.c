/* A program for a debugger: threads, a signal, a child by fork and one by vfork, shared code. */
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

extern char **environ;
static volatile int counted[4];
static volatile int signals;
static volatile int scale = 1;
static volatile int millimetres;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

/* Threads and children call it. */
static void count(int who) {
    pthread_mutex_lock(&lock);
    counted[who] += scale;
    pthread_mutex_unlock(&lock);
}

static void on_signal(int number) {
    (void)number;
    signals++;
}

static void *worker(void *none) {
    (void)none;
    for (;;) {
        struct timespec pause = {0, 70000000};
        nanosleep(&pause, NULL);
        count(1);
    }
}

static void beat(int port, int number) {
    char text[64];
    if (number == 3) raise(SIGUSR1);
    if (number == 5) {
        pid_t child = fork();
        if (child == 0) {
            count(3);
            _exit(counted[3]);
        }
        int status = 0;
        waitpid(child, &status, 0);
        counted[3] = WEXITSTATUS(status);
    }
    if (number == 7) {
        pid_t child;
        char *words[] = {"true", NULL};
        if (posix_spawn(&child, "/bin/true", NULL, NULL, words, environ) == 0) waitpid(child, NULL, 0);
    }
    int len = snprintf(text, sizeof text, "%d,%d,%d,%d,%d,%d\r\n", number, counted[1], counted[2],
                       counted[3], signals, millimetres);
    if (write(port, text, (size_t)len) != len) exit(3);
}

static void understand(const char *line) {
    int value = 0;
    if (sscanf(line, "mm=%d", &value) == 1) {
        millimetres += value;
        count(2);
    }
}

int main(void) {
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    signal(SIGUSR1, on_signal);
    pthread_t thread;
    pthread_create(&thread, NULL, worker, NULL);
    char line[128];
    int len = 0;
    for (int number = 0;; number++) {
        struct timespec begun, now;
        clock_gettime(CLOCK_MONOTONIC, &begun);
        do {
            struct pollfd polled = {port, POLLIN, 0};
            poll(&polled, 1, 30);
            char byte;
            if (polled.revents & POLLIN && read(port, &byte, 1) == 1) {
                line[len++] = byte;
                if (byte == '\n' || len > 100) {
                    line[len] = 0;
                    understand(line);
                    len = 0;
                }
            }
            clock_gettime(CLOCK_MONOTONIC, &now);
        } while ((now.tv_sec - begun.tv_sec) * 1000000000L + now.tv_nsec - begun.tv_nsec < 200000000L);
        beat(port, number);
    }
}

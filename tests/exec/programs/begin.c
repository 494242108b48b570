/* Opens its port in one of several ways, and writes seven bytes with pauses of 1, 3 and 7 ms
   between them directly after that. Prints the time of each write, counted from the first. */
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static long now(void) {
    struct timespec at;
    clock_gettime(CLOCK_MONOTONIC, &at);
    return at.tv_sec * 1000000000L + at.tv_nsec;
}

static int is_spinning;

static void pause_ms(int ms) {
    long until = now() + ms * 1000000L;
    if (is_spinning) {
        while (now() < until) {
        }
        return;
    }
    struct timespec time = {0, ms * 1000000L};
    nanosleep(&time, NULL);
}

static int opened(void) {
    int fd = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    if (fd < 0)
        exit(3);
    return fd;
}

static void send_all(int fd) {
    const int pauses[] = {1, 3, 7, 1, 3, 7};
    long begin = now();
    for (int index = 0; index < 7; index++) {
        if (write(fd, &"abcdefg"[index], 1) != 1)
            exit(4);
        printf("%c %ld\n", "abcdefg"[index], now() - begin);
        if (index < 6)
            pause_ms(pauses[index]);
    }
    fflush(stdout);
}

static void *in_thread(void *fd) {
    send_all(*(int *)fd);
    return NULL;
}

int main(int count, char **words) {
    const char *way = count > 1 ? words[1] : "";
    is_spinning = count > 2;
    if (!strcmp(way, "late"))
        usleep(123457);
    int fd = opened();
    if (!strcmp(way, "raw")) {
        struct termios raw;
        tcgetattr(fd, &raw);
        cfmakeraw(&raw);
        cfsetspeed(&raw, B9600);
        tcsetattr(fd, TCSANOW, &raw);
    } else if (!strcmp(way, "twice")) {
        close(fd);
        fd = opened();
    } else if (!strcmp(way, "both")) {
        close(opened());
    }
    if (!strcmp(way, "fork") || !strcmp(way, "child")) {
        int is_child = !strcmp(way, "child");
        pid_t child = fork();
        if ((child == 0) == is_child)
            send_all(fd);
        if (child == 0)
            _exit(0);
        waitpid(child, NULL, 0);
    } else if (!strcmp(way, "thread")) {
        pthread_t thread;
        pthread_create(&thread, NULL, in_thread, &fd);
        pthread_join(thread, NULL);
    } else {
        send_all(fd);
    }
    pause_ms(50);
    return 0;
}

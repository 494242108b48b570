// Calls that wait for something other than a port: a signal's file, a named pipe, a lock, a reader
// of a full pipe, a socket with a time limit, a POSIX timer. Each line has its virtual time.
#define _GNU_SOURCE
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static volatile int ticks;

static void tick(int number) {
    (void)number;
    ticks++;
}

static void say(const char *what, long value) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    printf("%ld.%03ld %s %ld\n", (long)t.tv_sec, t.tv_nsec / 1000000, what, value);
    fflush(stdout);
}

static void signals(void) {
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGALRM);
    sigprocmask(SIG_BLOCK, &set, 0);
    struct itimerval in = {{0, 0}, {0, 200000}};
    setitimer(ITIMER_REAL, &in, 0);
    struct signalfd_siginfo info;
    int fd = signalfd(-1, &set, 0);
    long len = read(fd, &info, sizeof info);
    say("signalfd", len > 0 ? (long)info.ssi_signo : -1);
    close(fd);
    sigprocmask(SIG_UNBLOCK, &set, 0);
}

static void files(void) {
    char byte = 'x';
    unlink("named");
    mkfifo("named", 0600);
    int lock = open("lock", O_CREAT | O_RDWR, 0600);
    if (!fork()) {
        int own = open("lock", O_RDWR);
        flock(own, LOCK_EX);
        usleep(30000);
        int out = open("named", O_WRONLY);
        usleep(50000);
        if (write(out, &byte, 1) != 1) _exit(1);
        _exit(0);
    }
    int in = open("named", O_RDONLY);
    say("named pipe", in >= 0);
    say("lock", flock(lock, LOCK_EX));
    say("byte", read(in, &byte, 1));
    wait(0);
}

static void streams(void) {
    int pipes[2], pair[2];
    if (pipe(pipes) || socketpair(AF_UNIX, SOCK_STREAM, 0, pair)) exit(1);
    static char much[200000];
    if (!fork()) {
        long count = 0, len;
        close(pipes[1]);
        while ((len = read(pipes[0], much, 7777)) > 0) count += len;
        say("read", count);
        _exit(0);
    }
    say("wrote", write(pipes[1], much, sizeof much));
    close(pipes[1]);
    wait(0);
    struct timeval limit = {0, 70000};
    setsockopt(pair[0], SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    say("limit", recv(pair[0], much, 1, 0));
}

static void timers(void) {
    timer_t timer;
    struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGUSR2};
    struct itimerspec each = {{0, 40000000}, {0, 40000000}};
    struct timespec nap = {0, 300000000};
    signal(SIGUSR2, tick);
    timer_create(CLOCK_MONOTONIC, &event, &timer);
    timer_settime(timer, 0, &each, 0);
    while (nanosleep(&nap, &nap)) {
    }
    timer_delete(timer);
    say("ticks", ticks);
}

int main(void) {
    open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    signals();
    files();
    streams();
    timers();
    return 0;
}

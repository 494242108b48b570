/* Reads of ports that need no stop: each line is the same if every call is a stop. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/select.h>
#include <sys/time.h>
#include <sys/uio.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static int port, pipes[2];
static volatile int alarms;

static long now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000000000L + t.tv_nsec;
}
static void on_alarm(int signal) {
    (void)signal;
    alarms++;
}
static void set_flags(int least, int tenths, tcflag_t input, tcflag_t control) {
    struct termios raw;
    tcgetattr(port, &raw);
    cfmakeraw(&raw);
    cfsetspeed(&raw, B9600);
    raw.c_iflag |= input;
    raw.c_cflag = (raw.c_cflag & ~CRTSCTS) | control;
    raw.c_cc[VMIN] = least;
    raw.c_cc[VTIME] = tenths;
    tcsetattr(port, TCSANOW, &raw);
}
static void set(int least, int tenths) { set_flags(least, tenths, 0, 0); }
/* As pyserial does it: a pipe by which another thread may end the wait is in the set. */
static int wait_for(long micros, long *left) {
    fd_set set;
    struct timeval time = {micros / 1000000, micros % 1000000};
    FD_ZERO(&set);
    FD_SET(port, &set);
    FD_SET(pipes[0], &set);
    int ready = select((port > pipes[0] ? port : pipes[0]) + 1, &set, 0, 0, &time);
    *left = time.tv_sec * 1000000 + time.tv_usec;
    return ready < 0 ? -errno : 10 * !!FD_ISSET(port, &set) + 100 * !!FD_ISSET(pipes[0], &set) + ready;
}
static void report(const char *name, unsigned long sum) { printf("%s: %lu\n", name, sum); }
/* All that a program can tell of its reads: when, what, how much, and how much time was left. */
static unsigned long reads(int count, int length, int selects) {
    unsigned long sum = 0;
    char bytes[100];
    for (int i = 0; i < count; i++) {
        long left = 0;
        int ready = selects ? wait_for(150000, &left) : 0;
        int got = read(port, bytes, length);
        sum = sum * 31 + now() + left * 7 + ready + got;
        for (int k = 0; k < got; k++)
            sum = sum * 31 + bytes[k];
    }
    return sum;
}

static unsigned long reads_of(int count) { return reads(count, 1, 1); }

/* The last three bytes of a line come while the program looks at clocks; then a wait counts from the
   last one. */
static unsigned long late_tenths(void) {
    unsigned long sum = 0;
    for (int i = 0; i < 6; i++) {
        set(1, 0);
        sum = sum * 31 + reads(5, 1, 1);
        for (long until = now() + 7000000 + 1700000 * (i % 3); now() < until;);
        set(4, 1);
        sum = sum * 31 + reads(1, 8, 0);
    }
    return sum;
}
/* Bytes that no stopped call has put into a pipe, and the end of one whose writer has a high
   number. */
static unsigned long quiet_pipes(void) {
    long left;
    char bytes[100];
    int old = pipes[0], others[2];
    struct iovec piece = {"x", 1};
    set(1, 0);
    unsigned long sum = reads(40, 1, 1) + wait_for(100000, &left) + left;
    sum = sum * 31 + vmsplice(pipes[1], &piece, 1, 0);
    sum = sum * 31 + wait_for(100000, &left) + left + read(pipes[0], bytes, 9);
    pipe(others);
    sum = sum * 31 + reads(4, 1, 1) + write(others[1], "yz", 2) + wait_for(100000, &left) + left;
    sum = sum * 31 + tee(others[0], pipes[1], 2, 0);
    sum = sum * 31 + wait_for(100000, &left) + left + read(pipes[0], bytes, 9);
    read(others[0], bytes, 9);
    dup2(others[1], 300);
    close(others[1]);
    pipes[0] = others[0];
    sum = sum * 31 + reads(4, 1, 1) + wait_for(100000, &left) + left;
    close(300);
    sum = sum * 31 + wait_for(100000, &left) + left + read(pipes[0], bytes, 9);
    close(others[0]);
    pipes[0] = old;
    return sum;
}
/* `read` on a stack of which so many bytes are left: the call itself takes none. */
static long read_on(char *stack, char *byte) {
    long got;
    __asm__ volatile("mov %%rsp, %%rbx\n\tmov %[stack], %%rsp\n\tcall read\n\tmov %%rbx, %%rsp"
                     : "=a"(got)
                     : [stack] "r"(stack), "D"(port), "S"(byte), "d"(1L)
                     : "rbx", "rcx", "r8", "r9", "r10", "r11", "memory", "cc");
    return got;
}
static unsigned long small_stacks(void) {
    long page = 4096;
    char *guard = mmap(0, 2 * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    unsigned long sum = 0;
    mprotect(guard, page, PROT_NONE);
    set(1, 0);
    for (int left = 16; left <= 304; left += 8) {
        char byte;
        sum = sum * 31 + read_on(guard + page + left, &byte) + byte + now();
    }
    return sum;
}
static pthread_mutex_t gate = PTHREAD_MUTEX_INITIALIZER;
static volatile long taken;

static void *takes(void *sum) {
    char byte;
    pthread_mutex_lock(&gate);
    if (sum) {
        *(unsigned long *)sum = reads(200, 1, 0);
        return 0;
    }
    for (;;) taken += read(port, &byte, 1);
}
/* A thread reads while others wait; one that is cancelled before it reads takes no byte. */
static unsigned long in_threads(int is_cancelled) {
    pthread_t thread;
    unsigned long sum = 0;
    set(1, 0);
    taken = 0;
    pthread_mutex_lock(&gate);
    pthread_create(&thread, 0, takes, is_cancelled ? 0 : &sum);
    usleep(50000);
    if (is_cancelled) pthread_cancel(thread);
    pthread_mutex_unlock(&gate);
    pthread_join(thread, 0);
    pthread_mutex_init(&gate, 0);
    return sum + taken * 1000 + now();
}

static char pings[4096];

static void write_pings(void) {
    for (size_t i = 0; i < sizeof pings; i++)
        pings[i] = "ping\r\n"[i % 6];
    write(port, pings, sizeof pings);
}
/* After the run no byte leaves: neither room for them nor the line's end is waited for. */
static void on_end(int signal) {
    (void)signal;
    for (int i = 0; i < 3; i++)
        write_pings();
    tcdrain(port);
    _exit(0);
}
/* Settings with which each call is a stop, then more to send than the run has time for. */
static void stops_and_fills(void) {
    set_flags(0, 0, 0, CRTSCTS);
    report("rtscts", reads(30, 1, 1));
    set_flags(0, 0, BRKINT, 0);
    report("breaks", reads(30, 1, 1));
    signal(SIGTERM, on_end);
    write_pings();
    for (;;)
        reads(1, 1, 1);
}

int main(int count, char **words) {
    long left;
    char bytes[100];
    setvbuf(stdout, 0, _IONBF, 0);
    port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    if (pipe(pipes))
        return 1;
    if (count > 1 && !strcmp(words[1], "late")) {
        report("late tenths", late_tenths());
        return 0;
    }
    if (count > 1)
        stops_and_fills();
    set(0, 0);
    report("selects", reads(300, 1, 1));
    report("pieces", reads(100, 5, 1));
    set(1, 0);
    report("waits", reads(300, 1, 0));
    /* Requests between the reads. */
    unsigned long sum = 0;
    for (int i = 0; i < 20; i++) {
        sum = sum * 31 + write(port, "ping\r\n", 6);
        sum = sum * 31 + reads(9, 1, 1);
    }
    for (int i = 0; i < 20; i++) {
        /* As pyserial writes: it waits until the port takes bytes. */
        fd_set reads, writes;
        sum = sum * 31 + write(port, "ping\r\n", 6);
        FD_ZERO(&reads);
        FD_SET(pipes[0], &reads);
        if (i % 2)
            FD_SET(port, &reads);
        FD_ZERO(&writes);
        FD_SET(port, &writes);
        sum = sum * 31 + select(20, &reads, &writes, 0, 0) + FD_ISSET(port, &reads);
        sum = sum * 31 + FD_ISSET(port, &writes) + FD_ISSET(pipes[0], &reads) + now();
        sum = sum * 31 + reads_of(7);
    }
    report("requests", sum);
    /* How many there are, asked for a while, and asked too often. */
    sum = 0;
    for (int i = 0; i < 400; i++) {
        int there = -1;
        sum = sum * 31 + ioctl(port, FIONREAD, &there) + there + now();
        if (there >= 3 + i % 4)
            sum = sum * 31 + read(port, bytes, there - 1) + bytes[0];
        if (i % 40 == 39)
            sum = sum * 31 + reads(30, 1, 1);
    }
    report("counts", sum);
    /* More than is lent at once waits. */
    usleep(900000);
    report("full", reads(60, 3, 1));
    set(0, 0);
    report("times out", reads(40, 1, 1));
    sum = 0;
    for (int i = 0; i < 200; i++)
        sum = sum * 31 + wait_for(20000, &left) + left + now();
    report("short times", sum);
    /* Buffers that are none. */
    wait_for(1000000, &left);
    sum = reads(3, 1, 1);
    wait_for(1000000, &left);
    int got = read(port, (void *)8, 1);
    sum = sum * 31 + (got < 0 ? errno : 1000);
    got = syscall(270, port + 1, (void *)8, 0, 0, 0, 0);
    sum = sum * 31 + (got < 0 ? errno : 1000) + now();
    sum = sum * 31 + reads(3, 1, 1);
    report("faults", sum);
    /* A copy of the file, another mode of it, and the pipe. */
    int copy = dup(port);
    sum = reads(4, 1, 1) + read(copy, bytes, 2) + bytes[0] + reads(4, 1, 1);
    close(copy);
    fcntl(port, F_SETFL, O_NONBLOCK);
    for (int i = 0; i < 20; i++) {
        got = read(port, bytes, 1);
        sum = sum * 31 + (got < 0 ? errno : got + bytes[0]) + now();
    }
    fcntl(port, F_SETFL, 0);
    report("copies", sum);
    sum = reads(4, 1, 1) + write(pipes[1], "x", 1);
    sum = sum * 31 + wait_for(100000, &left) + left;
    sum = sum * 31 + read(pipes[0], bytes, 9) + reads(4, 1, 1);
    report("pipe", sum);
    /* Signals that come between and in reads. */
    struct sigaction action = {.sa_handler = on_alarm};
    sigaction(SIGALRM, &action, 0);
    struct itimerval timer = {{0, 7000}, {0, 7000}};
    setitimer(ITIMER_REAL, &timer, 0);
    set(1, 0);
    sum = reads(200, 1, 0) + reads(200, 1, 1);
    timer = (struct itimerval){0};
    setitimer(ITIMER_REAL, &timer, 0);
    report("signals", sum * 31 + alarms);
    /* Two processes take turns. */
    int child = fork();
    report(child ? "parent" : "child", reads(20, 1, 1) + !!child);
    if (!child)
        _exit(0);
    set(0, 2);
    report("tenths", reads(30, 1, 1) + reads(30, 1, 0));
    set(4, 1);
    report("four", reads(20, 8, 1) + reads(20, 8, 0));
    report("quiet pipes", quiet_pipes());
    report("small stacks", small_stacks());
    report("threads", in_threads(0));
    report("cancelled", in_threads(1));
    printf("cancelled threads took %ld\n", taken);
    printf("%ld\n", now());
    return 0;
}

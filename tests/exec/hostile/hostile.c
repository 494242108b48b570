/* A program that attacks its supervisor: its words are what it does, one after the other.

     hostile open fork { setsid ignore:15 pause } thread { spin } exit:0

   A child process, a thread, or another program of the same kind does the words in braces. The file
   HOSTILE_NOTES gets a line when a process exits, hangs or computes for ever. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/sched.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/auxv.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/ptrace.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

enum { NOTES = 900 };
static char **words;
static int all, port = -1, first, pipes[2] = {-1, -1};
static pthread_t threads[64];
static int threads_made;

static int run(int at);
static void nap(long ms)
{
    struct timespec t = {ms / 1000, ms % 1000 * 1000000};
    while (nanosleep(&t, &t) && errno == EINTR) {}
}

static void note(const char *what)
{
    char text[64];
    int len = snprintf(text, sizeof text, "%s %s\n", getpid() == first ? "first" : "other", what);
    if (write(NOTES, text, len) < 0) return;
}

static void handler(int number) { (void)number; }
static void handler_raises(int number)
{
    static volatile int left = 200;
    if (left-- > 0) raise(number);
}

static int int_80(int number, long one, long two)
{
    int result;
    __asm__ volatile("int $0x80" : "=a"(result) : "a"(number), "b"(one), "c"(two), "d"(0)
                     : "r8", "r9", "r10", "r11", "memory");
    return result;
}

static void opens(long a)
{
    struct termios termios;
    const char *path = getenv("HILRIG_PORT_SONAR");
    int mode = a == 1 ? O_RDONLY : a == 2 ? O_WRONLY : O_RDWR;
    port = open(path ? path : "/dev/null", mode | O_NOCTTY);
    if (tcgetattr(port, &termios)) return;
    cfmakeraw(&termios);
    cfsetspeed(&termios, B9600);
    tcsetattr(port, TCSANOW, &termios);
}

static void act_read(long a, long b)
{
    char bytes[256];
    (void)b;
    if (a >= 100) note("reads");
    for (long i = 0; i < (a ? a : 1); i++)
        if (read(port, bytes, sizeof bytes) <= 0) break;
}
static void act_open(long a, long b) { (void)b; opens(a); }
static void act_write(long a, long b)
{
    static char bytes[9000];
    (void)b;
    if (write(port, bytes, a > 9000 ? 9000 : a) < 0) return;
}
static void act_excl(long a, long b) { (void)b; ioctl(port, a ? TIOCNXCL : TIOCEXCL); }
static void act_break(long a, long b) { (void)a, (void)b; tcsendbreak(port, 0); }
static void act_flags(long a, long b) { (void)b; fcntl(port, F_SETFL, a ? O_NONBLOCK : O_ASYNC); }
static void act_sleep(long a, long b) { (void)b; nap(a); }
static void act_pause(long a, long b) { (void)a, (void)b; note("hangs"); for (;;) pause(); }
static void act_spin(long a, long b)
{
    (void)a, (void)b;
    note("spins");
    for (volatile int i = 0;; i++) {}
}
static void act_compute(long a, long b) { (void)b; for (volatile long i = 0; i < a * 1000; i++) {} }
static void act_yield(long a, long b) { (void)b; while (a--) sched_yield(); }
static void act_clock(long a, long b)
{
    struct timespec now;
    (void)b;
    while (a--) time(0), clock_gettime(CLOCK_REALTIME, &now);
}
static void act_exit(long a, long b)
{
    (void)b;
    note(a ? "exits with an error" : "exits");
    _exit(a);
}
static void act_ends(long a, long b)
{
    (void)a, (void)b;
    note("thread ends");
    syscall(SYS_exit, 0);
}
static void act_leaves(long a, long b) { (void)a, (void)b; note("leaves"); pthread_exit(0); }
static void act_ignore(long a, long b) { (void)b; signal(a, SIG_IGN); }
static void act_handle(long a, long b) { signal(a, b ? handler_raises : handler); }
static void act_block(long a, long b)
{
    sigset_t set;
    (void)b;
    sigemptyset(&set);
    if (a) sigaddset(&set, a); else sigfillset(&set);
    sigprocmask(SIG_BLOCK, &set, 0);
}
static void act_raise(long a, long b) { (void)b; raise(a); }
static void act_first(long a, long b)
{
    (void)b;
    if (first > 1 && (getpid() == first || getppid() == first)) kill(first, a);
}
static void act_group(long a, long b) { (void)b; kill(0, a); }
/* Processes and owners that there cannot be; never -1, which is all of the machine. */
static void act_unknown(long a, long b)
{
    const int none[] = {-0x7FFFFFFF - 1, -0x7FFFFFFF, 0x7FFFFFFF, -0x7FFFFFFE};
    kill(none[a % 4], b);
    fcntl(port, F_SETOWN, none[a % 4]);
    fcntl(port, F_SETSIG, b);
    fcntl(port, F_SETFL, O_ASYNC);
    if (syscall(SYS_tgkill, none[a % 4], none[a % 4], b)) errno = 0;
}
static void act_wait(long a, long b)
{
    (void)b;
    if (a) note("hangs");
    while (waitpid(-1, 0, a == 2 ? __WALL : 0) > 0 || errno == EINTR) {}
    if (a) note("goes on");
}
static void act_setsid(long a, long b) { (void)a, (void)b; setsid(); }
static void act_setpgid(long a, long b) { (void)a, (void)b; setpgid(0, 0); }
static void act_close(long a, long b) { (void)b; close(a); }
static void act_closes(long a, long b) { (void)a, (void)b; close_range(0, NOTES - 1, 0); }
static void act_pipe(long a, long b)
{
    static char bytes[70000];
    if (pipe(pipes)) return;
    if (a) close(pipes[0]);
    if (b) note("hangs");
    if (write(pipes[1], bytes, b ? sizeof bytes : 100) < 0) errno = 0;
    if (b) note("goes on");
}
static void act_empty(long a, long b)
{
    char byte;
    int ends[2];
    (void)a, (void)b;
    if (pipe(ends)) return;
    note("hangs");
    if (read(ends[0], &byte, 1) < 0) note("goes on");
}
static void act_lock(long a, long b)
{
    static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
    (void)a, (void)b;
    pthread_mutex_lock(&mutex);
    note("hangs");
    pthread_mutex_lock(&mutex);
}
static void act_poll(long a, long b)
{
    struct pollfd one[2] = {{port, POLLIN, 0}, {77, POLLIN, 0}};
    for (long i = 0; i < b; i++) poll(one, 1 + i % 2, a);
}
static void act_traceme(long a, long b) { (void)a, (void)b; ptrace(PTRACE_TRACEME, 0, 0, 0); }
static void act_attach(long a, long b)
{
    if (first < 2) return;
    if (ptrace(a ? PTRACE_SEIZE : PTRACE_ATTACH, first, 0, 0) == 0) waitpid(first, 0, __WALL);
    (void)b;
}
static void act_prctl(long a, long b) { prctl(a, b, 0, 0, 0); }
static void act_limit(long a, long b)
{
    struct rlimit limit = {b, b};
    setrlimit(a, &limit);
}
static void act_alarm(long a, long b)
{
    struct itimerval each = {{0, a}, {0, a}};
    setitimer(b, &each, 0);
}
static void act_timers(long a, long b)
{
    struct itimerspec each = {{0, b * 1000}, {0, b * 1000}};
    for (long i = 0; i < a; i++) {
        struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGRTMIN + i % 20};
        timer_t timer;
        if (timer_create(CLOCK_MONOTONIC, &event, &timer) == 0) timer_settime(timer, 0, &each, 0);
    }
}
static void act_int80(long a, long b)
{
    if (a == 1 || a == 252) note("exits");
    if (a == 29 || a == 72) note("hangs");
    int was = getpid(), result = int_80(a, b, 0);
    if (a == 29 || a == 72) note("goes on");
    if ((a == 2 || a == 190) && result == 0 && getpid() != was) _exit(0);
}
static void act_unmap(long a, long b)
{
    char *kernels = (char *)getauxval(AT_SYSINFO_EHDR);
    (void)b;
    if (a) mprotect(kernels, 4096, PROT_NONE); else munmap(kernels, 3 * 4096);
}
static void act_map(long a, long b)
{
    int kind = MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE;
    char *place = mmap(0, a << 20, PROT_READ | PROT_WRITE, kind, -1, 0);
    if (place == MAP_FAILED) return;
    if (b) mprotect(place, a << 20, PROT_NONE);
    /* Bad places for what calls fill. */
    if (read(port, place, 10) < 0 || clock_gettime(0, (void *)place)) errno = 0;
    poll((void *)place, 3, 0);
    syscall(SYS_futex, place, 0, 1, 0, 0, 0);
    syscall(SYS_nanosleep, place, 1L);
    syscall(SYS_readv, port, -8L, 3L);
    syscall(SYS_select, 100L, place, place + 64, -1L, place);
}
static long deep(long left)
{
    volatile char room[1 << 16];
    room[0] = left;
    return left ? deep(left - 1) + room[0] : 0;
}
static void act_stack(long a, long b) { (void)b; deep(a); }
static void act_fault(long a, long b)
{
    if (b) signal(SIGSEGV, handler), note("spins");
    if (a == 0) *(volatile int *)8 = 1;
    if (a == 1) abort();
    if (a == 2) __asm__ volatile("ud2");
    if (a == 3) __asm__ volatile("int3");
    if (a == 4) __asm__ volatile("hlt");
    if (a == 5) __asm__ volatile("rdtsc; rdtscp" : : : "rax", "rdx", "rcx");
}
static void act_unshare(long a, long b) { (void)b; if (unshare(a)) errno = 0; }
static void act_setuid(long a, long b) { (void)b; if (setgid(a) || setuid(a)) errno = 0; }
static void act_socket(long a, long b)
{
    int ends[2];
    char bytes[8];
    if (socketpair(AF_UNIX, a ? SOCK_DGRAM : SOCK_STREAM, 0, ends)) return;
    struct timeval limit = {0, 20000};
    setsockopt(ends[0], SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    if (recv(ends[0], bytes, 8, 0) < 0 && b) shutdown(ends[0], SHUT_RDWR);
}
/* Places at the end of the address space, for what a call reads or fills. */
static void act_bad(long a, long b)
{
    long place = -8 - 8 * b;
    syscall(a, (long)port, place, 16L, place, place, place);
    syscall(a, (long)port, place, place, place, place, place);
    syscall(a, place, 1L, place, place, place, place);
    syscall(a, 0L, place, place, place, place, place);
}
/* A signal, or a fault, while the stack is nowhere. */
static void act_stackless(long a, long b)
{
    const long places[] = {0, 8, 64, -8, 0x7FFFFFFFFFF8, 0x800000000000};
    int pid = getpid();
    __asm__ volatile("mov %0, %%rsp; mov $62, %%eax; syscall; ud2"
                     : : "r"(places[b % 6]), "D"(pid), "S"(a) : "rax", "rcx", "r11", "memory");
}
/* Timers that expire all the time. */
static void act_storm(long a, long b)
{
    struct itimerspec each = {{0, 1}, {0, 1}};
    struct itimerval micros = {{0, 1}, {0, 1}};
    struct sigevent event = {.sigev_notify = a == 0 ? SIGEV_NONE : SIGEV_SIGNAL, .sigev_signo = b};
    timer_t timer;
    if (a < 2 && timer_create(CLOCK_MONOTONIC, &event, &timer) == 0) timer_settime(timer, 0, &each, 0);
    if (a == 2) timerfd_settime(timerfd_create(CLOCK_MONOTONIC, 0), 0, &each, 0);
    if (a == 3) signal(SIGALRM, SIG_IGN), setitimer(ITIMER_REAL, &micros, 0);
}
/* The page from which hilrig answers looks at clocks and reads: all that can be written to it. Its
   words are listed in crates/realtime/src/guest/clock_page.s. */
static void act_page(long a, long b)
{
    const long values[] = {0, 1, 1L << 62, -1};
    long value = values[b % 4];
    char line[256];
    unsigned long from = 0, to = 0;
    FILE *maps = fopen("/proc/self/maps", "r");
    while (maps && fgets(line, sizeof line, maps) && !(strstr(line, "rwxp") && sscanf(line, "%lx-%lx", &from, &to) == 2))
        from = to = 0;
    if (maps) fclose(maps);
    if (!from) return;
    volatile long *data = (long *)(to - 4096);
    char bytes[8];
    struct timespec now;
    for (int round = 0; round < 3; round++) {
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (a == 0) data[0] = value;
        if (a == 1) data[3] = data[9] = data[11] = value;
        if (a == 2) {
            data[8] = b ? 64 : 1;
            for (int i = 0; i < 64; i++) data[2304 / 8 + i] = value;
        }
        if (a == 3) for (int i = 0; i < 512; i++) data[i] = value;
        if (a == 4) mprotect((void *)(to - 4096), 4096, PROT_READ | PROT_EXEC);
        if (a == 5) munmap((void *)(to - 4096), 4096);
        clock_gettime(CLOCK_MONOTONIC, &now);
        if (port >= 0 && read(port, bytes, 8) < 0) return;
    }
}
static void act_call(long a, long b) { syscall(a, b, b, b, b, b, b); }

static const struct {
    const char *name;
    void (*act)(long, long);
} acts[] = {
    {"open", act_open}, {"read", act_read}, {"write", act_write}, {"excl", act_excl},
    {"break", act_break}, {"flags", act_flags}, {"sleep", act_sleep}, {"pause", act_pause}, {"spin", act_spin},
    {"compute", act_compute}, {"yield", act_yield}, {"clock", act_clock}, {"exit", act_exit},
    {"ends", act_ends}, {"leaves", act_leaves}, {"ignore", act_ignore}, {"handle", act_handle},
    {"block", act_block}, {"raise", act_raise}, {"first", act_first}, {"group", act_group}, {"unknown", act_unknown},
    {"wait", act_wait}, {"setsid", act_setsid}, {"setpgid", act_setpgid}, {"close", act_close},
    {"closes", act_closes}, {"pipe", act_pipe}, {"empty", act_empty}, {"lock", act_lock},
    {"poll", act_poll}, {"traceme", act_traceme}, {"attach", act_attach}, {"prctl", act_prctl},
    {"limit", act_limit}, {"alarm", act_alarm}, {"timers", act_timers}, {"int80", act_int80},
    {"unmap", act_unmap}, {"map", act_map}, {"stack", act_stack}, {"fault", act_fault},
    {"unshare", act_unshare}, {"setuid", act_setuid}, {"socket", act_socket}, {"call", act_call},
    {"bad", act_bad}, {"stackless", act_stackless}, {"storm", act_storm},
    {"page", act_page},
};

static int end_of(int at)
{
    int depth = 0;
    for (; at < all; at++) {
        depth += !strcmp(words[at], "{");
        if (!strcmp(words[at], "}") && --depth == 0) return at + 1;
    }
    return all;
}

static void *thread(void *at) { run((long)at); return 0; }
static int cloned(void *at) { run((long)at); _exit(0); }

static const unsigned long FLAGS[] = {
    SIGCHLD, CLONE_UNTRACED | SIGCHLD, CLONE_FILES | SIGCHLD,
    CLONE_VM | CLONE_FILES | CLONE_FS | CLONE_SIGHAND | SIGCHLD, CLONE_PARENT | SIGCHLD, 0, SIGUSR1,
    CLONE_NEWPID | SIGCHLD, CLONE_VFORK | CLONE_VM | SIGCHLD, CLONE_VFORK | SIGCHLD,
    CLONE_NEWUSER | SIGCHLD, CLONE_NEWPID | CLONE_NEWNS | CLONE_UNTRACED | SIGCHLD,
    CLONE_VM | SIGCHLD,
};

static void clones(unsigned long flags, int newer, int at)
{
    if (newer) {
        struct clone_args asked = {.flags = flags & ~0xFFul & ~CLONE_VM & ~CLONE_SIGHAND,
                                   .exit_signal = flags & 0xFF};
        if (syscall(SYS_clone3, &asked, sizeof asked) == 0) cloned((void *)(long)at);
        return;
    }
    char *stack = mmap(0, 1 << 20, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    clone(cloned, stack + (1 << 20), flags, (void *)(long)at);
}

/* As many processes as it says, each the child of the one before or all of one. */
static void bombs(int count, int deep, int at)
{
    for (int i = 0; i < count; i++) {
        int child = fork();
        if (deep ? child > 0 : child < 0) break;
        if (child == 0 && !deep) cloned((void *)(long)at);
    }
    if (deep && getpid() != first) cloned((void *)(long)at);
}

static void *again(int at)
{
    char *args[128] = {words[0]};
    int last = end_of(at - 1) - 1, count = 1;
    while (at < last && count < 126) args[count++] = words[at++];
    execv("/proc/self/exe", args);
    return 0;
}

/* What stands in braces after `name`. */
static void block(const char *name, long a, long b, int at)
{
    if (!strcmp(name, "fork") && fork() == 0) cloned((void *)(long)at);
    if (!strcmp(name, "vfork") && vfork() == 0) cloned((void *)(long)at);
    if (!strcmp(name, "clone")) clones(FLAGS[a % (sizeof FLAGS / sizeof *FLAGS)], b, at);
    if (!strcmp(name, "bomb")) bombs(a, b, at);
    if (!strcmp(name, "exec")) again(at);
    if (!strcmp(name, "daemon") && fork() == 0) {
        setsid();
        if (fork() == 0) cloned((void *)(long)at);
        _exit(0);
    }
    if (!strcmp(name, "thread") && threads_made < 64)
        threads_made += !pthread_create(&threads[threads_made], 0, thread, (void *)(long)at);
}

/* Does the words from `at` on, up to the brace that ends them. */
static int run(int at)
{
    while (at < all && strcmp(words[at], "}")) {
        char name[32];
        long a = 0, b = 0;
        sscanf(words[at], "%31[^:]:%ld:%ld", name, &a, &b);
        if (at + 1 < all && !strcmp(words[at + 1], "{")) {
            block(name, a, b, at + 2);
            at = end_of(at + 1);
            continue;
        }
        for (unsigned i = 0; i < sizeof acts / sizeof *acts; i++)
            if (!strcmp(acts[i].name, name)) acts[i].act(a, b);
        at++;
    }
    return at;
}

int main(int count, char **args)
{
    const char *known = getenv("HOSTILE_FIRST");
    char number[16];
    (words = args), (all = count);
    first = known ? atoi(known) : getpid();
    snprintf(number, sizeof number, "%d", first);
    setenv("HOSTILE_FIRST", number, 1);
    if (fcntl(NOTES, F_GETFD) < 0) {
        int fd = open(getenv("HOSTILE_NOTES"), O_WRONLY | O_APPEND | O_CREAT, 0666);
        dup2(fd, NOTES);
        close(fd);
    }
    run(1);
    note("exits");
    exit(0);
}

/* Signals that come of other calls than kill, futexes of other kinds, processors, processor time of
   children: each probe runs in a process of its own and says what it found, a line each. What is right
   is in the table of the test. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <linux/futex.h>
#include <mqueue.h>
#include <pthread.h>
#include <pty.h>
#include <sched.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

static const char *name;
static volatile int count;

static void say(const char *format, ...)
{
    va_list args;
    char text[200];
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    printf("%s: %s\n", name, text);
    fflush(stdout);
}

static long ms(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return t.tv_sec * 1000 + t.tv_nsec / 1000000;
}

/* To the nearest 10 ms. */
static long since(long begin) { return (ms() - begin + 5) / 10 * 10; }
static void nap(int wait) { usleep(wait * 1000); }
static void counts(int number) { (void)number, count++; }

static void catches(int number)
{
    struct sigaction action = {.sa_handler = counts};
    sigaction(number, &action, 0);
}

/* A child that does something 50 ms later; its end, which would be a sign as well, comes later. */
static int later(void (*what)(void))
{
    int child = fork();
    if (child) return child;
    nap(50);
    what();
    nap(300);
    _exit(0);
}

/* A sleep of a second, and what cut it short. */
static void sleeps(void)
{
    struct timespec second = {1, 0};
    long begin = ms();
    int got = nanosleep(&second, 0);
    say("%d %d after %ld ms", got, count, since(begin));
}

static int handle;
static void signals_by_file(void) { syscall(SYS_pidfd_send_signal, handle, SIGUSR1, 0, 0); }

static void pidfd_signals(void)
{
    handle = syscall(SYS_pidfd_open, getpid(), 0);
    catches(SIGUSR1);
    later(signals_by_file);
    sleeps();
}

static void pidfd_kills(void)
{
    int status, child = fork();
    while (!child) pause();
    nap(20);
    syscall(SYS_pidfd_send_signal, syscall(SYS_pidfd_open, child, 0), SIGKILL, 0, 0);
    long begin = ms();
    waitpid(child, &status, 0);
    say("%d after %ld ms", WIFSIGNALED(status) ? WTERMSIG(status) : -1, since(begin));
}

/* The kernel kills a child as its parent ends, and closes its end of a pipe by that. */
static void orphan_killed(void)
{
    int ends[2];
    char byte;
    (void)!pipe(ends);
    if (!fork()) {
        if (!fork()) {
            prctl(PR_SET_PDEATHSIG, SIGKILL);
            nap(1000);
            _exit(0);
        }
        nap(50);
        _exit(0);
    }
    close(ends[1]);
    long begin = ms();
    int got = read(ends[0], &byte, 1);
    say("%d after %ld ms", got, since(begin));
}

static void *types_interrupt(void *master)
{
    nap(50);
    (void)!write(*(int *)master, "\3", 1);
    nap(300);
    return 0;
}

static void pty_interrupt(void)
{
    int status, master;
    pid_t child = forkpty(&master, 0, 0, 0);
    while (!child) pause();
    pthread_t thread;
    long begin = ms();
    pthread_create(&thread, 0, types_interrupt, &master);
    waitpid(child, &status, 0);
    say("%d after %ld ms", WIFSIGNALED(status) ? WTERMSIG(status) : -1, since(begin));
}

static void pty_size(void)
{
    struct winsize size = {40, 100, 0, 0};
    int master, out = dup(1);
    pid_t child = forkpty(&master, 0, 0, 0);
    if (!child) {
        dup2(out, 1);
        catches(SIGWINCH);
        sleeps();
        _exit(0);
    }
    nap(50);
    ioctl(master, TIOCSWINSZ, &size);
    waitpid(child, 0, 0);
}

static void pty_hangup(void)
{
    int status, master;
    pid_t child = forkpty(&master, 0, 0, 0);
    while (!child) pause();
    nap(50);
    long begin = ms();
    close(master);
    waitpid(child, &status, 0);
    say("%d after %ld ms", WIFSIGNALED(status) ? WTERMSIG(status) : -1, since(begin));
}

static mqd_t queue;
static void sends(void) { mq_send(queue, "x", 2, 0); }

static void mq_tells(void)
{
    struct mq_attr attr = {.mq_maxmsg = 2, .mq_msgsize = 16};
    struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGUSR1};
    char file[32];
    snprintf(file, sizeof file, "/hilrig-more-%d", getpid());
    queue = mq_open(file, O_CREAT | O_RDWR, 0600, &attr);
    mq_unlink(file);
    catches(SIGUSR1);
    mq_notify(queue, &event);
    later(sends);
    sleeps();
}

static uint32_t words[2];
static void *waits(void *word)
{
    syscall(SYS_futex, word, FUTEX_WAIT | FUTEX_PRIVATE_FLAG, 0, 0, 0, 0);
    __sync_fetch_and_add(&count, 1);
    return 0;
}

/* The second word becomes 5; because it was 0, its thread is woken as well. */
static void futex_op(void)
{
    pthread_t threads[2];
    for (int i = 0; i < 2; i++) pthread_create(&threads[i], 0, waits, &words[i]);
    nap(10);
    long woken = syscall(SYS_futex, &words[0], FUTEX_WAKE_OP | FUTEX_PRIVATE_FLAG, 1, 1L, &words[1],
                         FUTEX_OP(FUTEX_OP_SET, 5, FUTEX_OP_CMP_EQ, 0));
    nap(10);
    say("%ld %d %u", woken, count, words[1]);
}

static void futex_many(void)
{
    struct {
        uint64_t value, address;
        uint32_t flags, reserved;
    } many[1] = {{0, (uint64_t)&words[0], 2 | FUTEX_PRIVATE_FLAG, 0}};
    long got = syscall(449, many, 1, 0, 0, CLOCK_MONOTONIC);
    say("%ld %d", got, errno == ENOSYS);
}

/* Each run has another processor: it is not to be seen. */
static void processor(void)
{
    cpu_set_t set;
    unsigned number = 9, node = 9;
    syscall(SYS_getcpu, &number, &node, 0);
    sched_getaffinity(0, sizeof set, &set);
    say("%d %u %u, %d %d", sched_getcpu(), number, node, CPU_COUNT(&set), CPU_ISSET(0, &set) != 0);
}

/* What is asked for is there, in children as well; a set without a processor is refused. */
static void affinity(void)
{
    cpu_set_t all, set;
    int status;
    memset(&all, 0xff, sizeof all);
    int done = sched_setaffinity(0, sizeof all, &all);
    if (!fork()) {
        sched_getaffinity(0, sizeof set, &set);
        _exit(CPU_COUNT(&set) == sysconf(_SC_NPROCESSORS_CONF));
    }
    wait(&status);
    CPU_ZERO(&set);
    int none = sched_setaffinity(0, sizeof set, &set);
    say("%d %d, %d %d", done, WEXITSTATUS(status), none, errno == EINVAL);
}

/* Expirations while the signal is pending are one signal (timer_getoverrun(2)). */
static void timer_overrun(void)
{
    timer_t timer;
    sigset_t set;
    siginfo_t info;
    struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGUSR2};
    struct itimerspec time = {{0, 10000000}, {0, 10000000}};
    sigemptyset(&set);
    sigaddset(&set, SIGUSR2);
    sigprocmask(SIG_BLOCK, &set, 0);
    timer_create(CLOCK_MONOTONIC, &event, &timer);
    timer_settime(timer, 0, &time, 0);
    nap(55);
    int first = sigwaitinfo(&set, &info), over = info.si_overrun, told = timer_getoverrun(timer);
    long begin = ms();
    int second = sigwaitinfo(&set, &info);
    say("%d %d %d %d, %d %d after %ld ms", first == SIGUSR2, over, told, info.si_code == SI_TIMER,
        second == SIGUSR2, info.si_overrun, since(begin));
}

/* Computing costs nothing here, and the time that the system measures is not to be seen. */
static void child_times(void)
{
    siginfo_t info = {0};
    struct rusage usage;
    int child = fork();
    if (!child) {
        volatile long sum = 0;
        for (long i = 0; i < 30000000; i++) sum += i;
        _exit(3);
    }
    while (waitid(P_PID, child, &info, WEXITED | WNOHANG) || !info.si_pid) nap(10);
    getrusage(RUSAGE_CHILDREN, &usage);
    say("%d %ld %ld %ld", info.si_status, (long)(info.si_utime + info.si_stime),
        (long)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec), usage.ru_maxrss);
}

static const struct {
    const char *name;
    void (*probe)(void);
} probes[] = {
    {"pidfd-signals", pidfd_signals}, {"pidfd-kills", pidfd_kills}, {"orphan-killed", orphan_killed},
    {"pty-interrupt", pty_interrupt}, {"pty-size", pty_size},       {"pty-hangup", pty_hangup},
    {"mq-tells", mq_tells},           {"futex-op", futex_op},       {"futex-many", futex_many},
    {"processor", processor},         {"affinity", affinity},       {"timer-overrun", timer_overrun},
    {"child-times", child_times},
};

int main(void)
{
    int port = open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    char bytes[64];
    // nohup ignores it, for its children as well.
    signal(SIGHUP, SIG_DFL);
    for (unsigned i = 0; i < sizeof probes / sizeof *probes; i++) {
        int child = fork();
        name = probes[i].name;
        if (!child) {
            probes[i].probe();
            _exit(0);
        }
        waitpid(child, 0, 0);
    }
    return read(port, bytes, sizeof bytes) <= 0;
}

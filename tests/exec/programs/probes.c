/* Waits, signals, locks, clocks and chance: each probe runs in a process of its own and says what it
   found, a line each. What is right is in the table of the test. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <mqueue.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/eventfd.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/msg.h>
#include <sys/resource.h>
#include <sys/sem.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <sys/sysinfo.h>
#include <sys/time.h>
#include <sys/timerfd.h>
#include <sys/timex.h>
#include <sys/wait.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static const char *name, *path;
static int port;
static volatile int count, depth, deepest, value, code;

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

static struct timespec calendar_in(int wait)
{
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    t.tv_nsec += wait * 1000000L;
    t.tv_sec += t.tv_nsec / 1000000000;
    t.tv_nsec %= 1000000000;
    return t;
}

static void nap(int wait) { usleep(wait * 1000); }

static void handle(int number, void (*handler)(int, siginfo_t *, void *), int flags)
{
    struct sigaction action = {.sa_sigaction = handler, .sa_flags = flags | SA_SIGINFO};
    sigaction(number, &action, 0);
}

static void counts(int number, siginfo_t *info, void *context)
{
    (void)number, (void)context;
    count++;
    value = info->si_value.sival_int;
    code = info->si_code;
}

static void again(int number, siginfo_t *info, void *context)
{
    (void)info, (void)context;
    depth++;
    if (depth > deepest) deepest = depth;
    if (count++ == 0) raise(number);
    depth--;
}

static void hold(int number, int how)
{
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, number);
    sigprocmask(how, &set, 0);
}

/* A child that does something 50 ms later. */
static int later(void (*what)(void *), void *with)
{
    int child = fork();
    if (child) return child;
    nap(50);
    what(with);
    _exit(0);
}

static void signals_parent(void *with)
{
    union sigval sent = {.sival_int = 7};
    sigqueue(getppid(), *(int *)with, sent);
}

/* Signals beyond 31. */

static void rt_raise(void)
{
    handle(SIGRTMIN + 2, counts, 0);
    raise(SIGRTMIN + 2);
    say("%d", count);
}

static void rt_highest(void)
{
    handle(SIGRTMAX, counts, 0);
    raise(SIGRTMAX);
    say("%d", count);
}

static void rt_value(void)
{
    union sigval sent = {.sival_int = 7};
    handle(SIGRTMIN + 1, counts, 0);
    sigqueue(getpid(), SIGRTMIN + 1, sent);
    say("%d %d", value, code == SI_QUEUE);
}

static void rt_held_while_handled(void)
{
    handle(SIGRTMIN, again, 0);
    raise(SIGRTMIN);
    say("%d times, %d deep", count, deepest);
}

static void rt_nodefer(void)
{
    handle(SIGRTMIN, again, SA_NODEFER);
    raise(SIGRTMIN);
    say("%d times, %d deep", count, deepest);
}

static char *low, *high;
static void on_stack(int number, siginfo_t *info, void *context)
{
    char here;
    (void)number, (void)info, (void)context;
    count = &here >= low && &here < high;
}

static void rt_altstack(void)
{
    low = malloc(1 << 16);
    high = low + (1 << 16);
    stack_t stack = {.ss_sp = low, .ss_size = 1 << 16};
    sigaltstack(&stack, 0);
    handle(SIGRTMIN, on_stack, SA_ONSTACK);
    raise(SIGRTMIN);
    int with = count;
    handle(SIGRTMIN, on_stack, 0);
    raise(SIGRTMIN);
    say("%d %d", with, count);
}

static void rt_reads(int flags)
{
    int ends[2], number = SIGRTMIN + 4;
    char byte;
    (void)!pipe(ends);
    handle(number, counts, flags);
    if (!fork()) {
        /* Until the parent reads, on a busy machine as well. */
        nap(300);
        signals_parent(&number);
        nap(30);
        (void)!write(ends[1], "x", 1);
        _exit(0);
    }
    int got = read(ends[0], &byte, 1);
    say("%d %s, %d", got, got < 0 ? strerror(errno) : "read", count);
}

static void rt_restart(void) { rt_reads(SA_RESTART); }
static void rt_interrupts(void) { rt_reads(0); }

static void rt_ignored(void)
{
    signal(SIGRTMIN + 5, SIG_IGN);
    raise(SIGRTMIN + 5);
    say("goes on");
}

static void rt_waited(void)
{
    siginfo_t info;
    sigset_t set;
    union sigval sent = {.sival_int = 5};
    hold(SIGRTMIN + 1, SIG_BLOCK);
    sigemptyset(&set);
    sigaddset(&set, SIGRTMIN + 1);
    sigqueue(getpid(), SIGRTMIN + 1, sent);
    int got = sigwaitinfo(&set, &info);
    say("%d %d", got - SIGRTMIN, info.si_value.sival_int);
}

static void rt_default(void)
{
    int status, child = fork();
    if (!child) {
        raise(SIGRTMIN + 1);
        _exit(0);
    }
    waitpid(child, &status, 0);
    say("%d", WIFSIGNALED(status) ? WTERMSIG(status) - SIGRTMIN : -1);
}

static void clobbers(int number, siginfo_t *info, void *context)
{
    (void)number, (void)info, (void)context;
    count++;
    __asm__ volatile("pxor %%xmm8, %%xmm8" ::: "xmm8");
}

static void rt_registers(void)
{
    long found, result;
    handle(SIGRTMIN, clobbers, 0);
    __asm__ volatile("movq %4, %%xmm8\n\tmov %5, %%eax\n\tsyscall\n\tmovq %%xmm8, %1"
                     : "=&a"(result), "=r"(found)
                     : "D"((long)getpid()), "S"((long)SIGRTMIN), "r"(0x1122334455667788L),
                       "i"(SYS_kill)
                     : "rcx", "r11", "memory", "xmm8");
    say("%d %lx %ld", count, found, result);
}

static sigjmp_buf back;
static void jumps(int number, siginfo_t *info, void *context)
{
    (void)number, (void)info, (void)context;
    siglongjmp(back, ++count);
}

static void rt_longjmp(void)
{
    handle(SIGRTMIN, jumps, 0);
    if (sigsetjmp(back, 1) < 3) raise(SIGRTMIN);
    say("%d", count);
}

static void rt_timer(void)
{
    timer_t timer;
    struct sigevent event = {.sigev_notify = SIGEV_SIGNAL, .sigev_signo = SIGRTMIN + 3};
    struct itimerspec time = {{0, 20000000}, {0, 20000000}};
    event.sigev_value.sival_int = 9;
    handle(SIGRTMIN + 3, counts, 0);
    timer_create(CLOCK_MONOTONIC, &event, &timer);
    timer_settime(timer, 0, &time, 0);
    long end = ms() + 110;
    while (ms() < end) usleep(1000);
    say("%d times, %d %d", count, value, code == SI_TIMER);
}

static void rt_suspend(void)
{
    int number = SIGRTMIN + 6;
    sigset_t none;
    handle(number, counts, 0);
    hold(number, SIG_BLOCK);
    later(signals_parent, &number);
    sigemptyset(&none);
    long begin = ms();
    int got = sigsuspend(&none);
    sigset_t held;
    sigprocmask(SIG_BLOCK, 0, &held);
    say("%d, %d after %ld ms, held %d", got, count, since(begin), sigismember(&held, number));
}

static void rt_ppoll(void)
{
    int number = SIGRTMIN + 7;
    sigset_t none;
    handle(number, counts, 0);
    hold(number, SIG_BLOCK);
    later(signals_parent, &number);
    sigemptyset(&none);
    int got = ppoll(0, 0, 0, &none);
    say("%d %d %d", got, errno == EINTR, count);
}

static void rt_file(void)
{
    struct signalfd_siginfo info = {0};
    int number = SIGRTMIN + 8;
    sigset_t set;
    hold(number, SIG_BLOCK);
    sigemptyset(&set);
    sigaddset(&set, number);
    int fd = signalfd(-1, &set, 0);
    later(signals_parent, &number);
    int got = read(fd, &info, sizeof info);
    say("%d %d %d", got == sizeof info, (int)info.ssi_signo - SIGRTMIN, info.ssi_int);
}

static void *sleeps(void *with)
{
    for (;;) sleep(1);
    return with;
}

static void *reads(void *with)
{
    char byte;
    for (;;) (void)!read(port, &byte, 1);
    return with;
}

static void cancel(void)
{
    pthread_t threads[2];
    void *results[2];
    pthread_create(&threads[0], 0, sleeps, 0);
    pthread_create(&threads[1], 0, reads, 0);
    nap(30);
    for (int i = 0; i < 2; i++) {
        pthread_cancel(threads[i]);
        pthread_join(threads[i], &results[i]);
    }
    say("%d %d", results[0] == PTHREAD_CANCELED, results[1] == PTHREAD_CANCELED);
}

static void drops_rights(void)
{
    pthread_t thread;
    pthread_create(&thread, 0, sleeps, 0);
    nap(20);
    say("%d", setgid(getgid()));
}

static void stops(void)
{
    int status, child = fork();
    if (!child) {
        raise(SIGSTOP);
        _exit(5);
    }
    waitpid(child, &status, WUNTRACED);
    int stopped = WIFSTOPPED(status) ? WSTOPSIG(status) : -1;
    kill(child, SIGCONT);
    waitpid(child, &status, 0);
    say("%d, then %d", stopped, WIFEXITED(status) ? WEXITSTATUS(status) : -1);
}

static void int_0x80(void)
{
    int pid;
    __asm__ volatile("int $0x80" : "=a"(pid) : "a"(20) : "r8", "r9", "r10", "r11", "memory");
    say("%d", pid == getpid());
}

/* Queues, semaphores and locks. */

static mqd_t queue;
static void sends(void *with) { mq_send(queue, "hello", 6, *(int *)with); }

static void opens_queue(void)
{
    struct mq_attr attr = {.mq_maxmsg = 2, .mq_msgsize = 16};
    char file[32];
    snprintf(file, sizeof file, "/hilrig%d", getpid());
    queue = mq_open(file, O_CREAT | O_RDWR, 0600, &attr);
    mq_unlink(file);
}

static void mq(void)
{
    int priority = 3;
    unsigned got_priority = 0;
    char text[16];
    opens_queue();
    later(sends, &priority);
    long begin = ms();
    int got = mq_receive(queue, text, sizeof text, &got_priority);
    say("%d %u after %ld ms", got, got_priority, since(begin));
}

static void mq_times_out(void)
{
    char text[16];
    opens_queue();
    struct timespec until = calendar_in(30);
    long begin = ms();
    int got = mq_timedreceive(queue, text, sizeof text, 0, &until);
    say("%d %d after %ld ms", got, errno == ETIMEDOUT, since(begin));
}

static void receives(void *with)
{
    char text[16];
    (void)with;
    (void)!mq_receive(queue, text, sizeof text, 0);
}

static void mq_full(void)
{
    opens_queue();
    mq_send(queue, "a", 2, 0);
    mq_send(queue, "b", 2, 0);
    later(receives, 0);
    long begin = ms();
    int got = mq_send(queue, "c", 2, 0);
    say("%d after %ld ms", got, since(begin));
}

static int id;
struct message {
    long type;
    char text[2048];
};
static void posts(void *with)
{
    struct message message = {2, "x"};
    (void)with;
    msgsnd(id, &message, 8, 0);
}

static void msg(void)
{
    struct message message;
    id = msgget(IPC_PRIVATE, 0600);
    later(posts, 0);
    long begin = ms();
    int got = msgrcv(id, &message, sizeof message.text, 2, 0);
    say("%d %ld after %ld ms", got, message.type, since(begin));
    msgctl(id, IPC_RMID, 0);
}

static void msg_nowait(void)
{
    struct message message;
    id = msgget(IPC_PRIVATE, 0600);
    int got = msgrcv(id, &message, 8, 0, IPC_NOWAIT);
    say("%d %d", got, errno == ENOMSG);
    msgctl(id, IPC_RMID, 0);
}

static void fetches(void *with)
{
    struct message message;
    (void)with;
    (void)!msgrcv(id, &message, sizeof message.text, 0, 0);
}

static void msg_full(void)
{
    struct message message = {1, ""};
    id = msgget(IPC_PRIVATE, 0600);
    struct msqid_ds limits;
    msgctl(id, IPC_STAT, &limits);
    limits.msg_qbytes = 2048;
    msgctl(id, IPC_SET, &limits);
    msgsnd(id, &message, 2048, 0);
    later(fetches, 0);
    long begin = ms();
    int got = msgsnd(id, &message, 2048, 0);
    say("%d after %ld ms", got, since(begin));
    msgctl(id, IPC_RMID, 0);
}

static void msg_removed(void)
{
    struct message message;
    id = msgget(IPC_PRIVATE, 0600);
    if (!fork()) {
        nap(50);
        msgctl(id, IPC_RMID, 0);
        _exit(0);
    }
    int got = msgrcv(id, &message, 8, 0, 0);
    say("%d %d", got, errno == EIDRM);
}

static void changes(void *with)
{
    struct sembuf operation = {0, *(int *)with, 0};
    semop(id, &operation, 1);
}

static void sem(void)
{
    int up = 1;
    struct sembuf down = {0, -1, 0};
    id = semget(IPC_PRIVATE, 1, 0600);
    later(changes, &up);
    long begin = ms();
    int got = semop(id, &down, 1);
    say("%d after %ld ms, flags %d", got, since(begin), down.sem_flg);
    semctl(id, 0, IPC_RMID);
}

static void sem_times_out(void)
{
    struct timespec limit = {0, 30000000};
    struct sembuf down = {0, -1, 0};
    id = semget(IPC_PRIVATE, 1, 0600);
    long begin = ms();
    int got = semtimedop(id, &down, 1, &limit);
    say("%d %d after %ld ms", got, errno == EAGAIN, since(begin));
    semctl(id, 0, IPC_RMID);
}

static void sem_zero(void)
{
    int down = -1;
    struct sembuf operations[2] = {{0, 0, 0}, {0, 1, 0}};
    id = semget(IPC_PRIVATE, 1, 0600);
    semctl(id, 0, SETVAL, 1);
    later(changes, &down);
    long begin = ms();
    int got = semop(id, operations, 2);
    say("%d after %ld ms, then %d", got, since(begin), semctl(id, 0, GETVAL));
    semctl(id, 0, IPC_RMID);
}

static void sem_undone(void)
{
    struct sembuf down = {0, -1, SEM_UNDO};
    id = semget(IPC_PRIVATE, 1, 0600);
    semctl(id, 0, SETVAL, 1);
    if (!fork()) {
        semop(id, &down, 1);
        nap(50);
        _exit(0);
    }
    nap(10);
    long begin = ms();
    int got = semop(id, &down, 1);
    say("%d after %ld ms", got, since(begin));
    semctl(id, 0, IPC_RMID);
}

static pthread_mutex_t *lock;
static void makes_lock(int robust)
{
    pthread_mutexattr_t attr;
    pthread_mutexattr_init(&attr);
    pthread_mutexattr_setprotocol(&attr, PTHREAD_PRIO_INHERIT);
    pthread_mutexattr_setpshared(&attr, PTHREAD_PROCESS_SHARED);
    if (robust) pthread_mutexattr_setrobust(&attr, PTHREAD_MUTEX_ROBUST);
    lock = mmap(0, 4096, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    pthread_mutex_init(lock, &attr);
}

static void *holds(void *with)
{
    pthread_mutex_lock(lock);
    nap(50);
    pthread_mutex_unlock(lock);
    return with;
}

static void pi_thread(void)
{
    pthread_t threads[2];
    makes_lock(0);
    for (int i = 0; i < 2; i++) pthread_create(&threads[i], 0, holds, 0);
    nap(10);
    int tried = pthread_mutex_trylock(lock);
    long begin = ms();
    int got = pthread_mutex_lock(lock);
    say("%d %d after %ld ms", tried == EBUSY, got, since(begin));
    pthread_mutex_unlock(lock);
    for (int i = 0; i < 2; i++) pthread_join(threads[i], 0);
}

static void pi_process(void)
{
    makes_lock(0);
    if (!fork()) {
        holds(0);
        _exit(0);
    }
    nap(10);
    long begin = ms();
    int got = pthread_mutex_lock(lock);
    say("%d after %ld ms", got, since(begin));
}

static void pi_times_out(void)
{
    pthread_t thread;
    makes_lock(0);
    pthread_create(&thread, 0, holds, 0);
    nap(10);
    struct timespec until = calendar_in(20);
    long begin = ms();
    int got = pthread_mutex_timedlock(lock, &until);
    say("%d after %ld ms", got == ETIMEDOUT, since(begin));
    pthread_join(thread, 0);
}

static void pi_robust(void)
{
    makes_lock(1);
    if (!fork()) {
        pthread_mutex_lock(lock);
        nap(50);
        _exit(0);
    }
    nap(10);
    int got = pthread_mutex_lock(lock);
    int mended = pthread_mutex_consistent(lock);
    say("%d %d %d", got == EOWNERDEAD, mended, pthread_mutex_unlock(lock));
}

static pthread_cond_t condition = PTHREAD_COND_INITIALIZER;
static void *wakes(void *with)
{
    nap(50);
    pthread_mutex_lock(lock);
    count = 1;
    pthread_cond_signal(&condition);
    pthread_mutex_unlock(lock);
    return with;
}

static void pi_condition(void)
{
    pthread_t thread;
    makes_lock(0);
    pthread_create(&thread, 0, wakes, 0);
    pthread_mutex_lock(lock);
    long begin = ms();
    while (!count) pthread_cond_wait(&condition, lock);
    say("after %ld ms", since(begin));
    pthread_mutex_unlock(lock);
    pthread_join(thread, 0);
}

static void adds(void *with)
{
    uint64_t one = 1;
    (void)!write(*(int *)with, &one, 8);
}

static void event(void)
{
    uint64_t got = 0;
    int fd = eventfd(0, 0);
    later(adds, &fd);
    long begin = ms();
    (void)!read(fd, &got, 8);
    say("%d after %ld ms", (int)got, since(begin));
}

static void socket_times_out(void)
{
    int ends[2];
    char byte;
    struct timeval limit = {0, 30000};
    socketpair(AF_UNIX, SOCK_STREAM, 0, ends);
    setsockopt(ends[0], SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    long begin = ms();
    int got = recv(ends[0], &byte, 1, 0);
    say("%d %d after %ld ms", got, errno == EAGAIN, since(begin));
}

static void timer_file(void)
{
    uint64_t got = 0;
    struct itimerspec time = {{0, 10000000}, {0, 30000000}};
    int fd = timerfd_create(CLOCK_MONOTONIC, 0);
    timerfd_settime(fd, 0, &time, 0);
    nap(55);
    (void)!read(fd, &got, 8);
    say("%d", (int)got);
}

/* Clocks, processor time, chance. */

static long ns(int clock, int by_call)
{
    struct timespec t;
    if (by_call) syscall(SYS_clock_gettime, clock, &t);
    else clock_gettime(clock, &t);
    return t.tv_sec * 1000000000 + t.tv_nsec;
}

/* A look costs the same with a stop and without. */
static void looks(void)
{
    long first = ns(CLOCK_MONOTONIC, 0), second = ns(CLOCK_MONOTONIC, 1);
    long third = ns(CLOCK_MONOTONIC, 0), fourth = ns(CLOCK_REALTIME, 0);
    long since = fourth - 1767225600000000000L - (third - 1000000000000L);
    say("%ld %ld %ld", second - first, third - second, since);
}

static void calendar(void)
{
    struct timeval now;
    gettimeofday(&now, 0);
    long other = time(0);
    struct timex timex = {0};
    adjtimex(&timex);
    say("%d %d", other - now.tv_sec <= 1, timex.time.tv_sec - now.tv_sec <= 1);
}

static void processor_time(void)
{
    struct rusage usage;
    volatile long sum = 0;
    for (long i = 0; i < 30000000; i++) sum += i;
    int child = fork();
    if (!child) _exit(0);
    wait4(child, 0, 0, &usage);
    long of_child = usage.ru_utime.tv_usec + usage.ru_stime.tv_usec;
    getrusage(RUSAGE_SELF, &usage);
    struct timespec now;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &now);
    long apart = (now.tv_sec - usage.ru_utime.tv_sec) * 1000000 + now.tv_nsec / 1000 - usage.ru_utime.tv_usec;
    say("%ld %ld %ld", of_child, apart, (long)usage.ru_maxrss);
}

static void uptime(void)
{
    struct sysinfo info;
    double seconds = 0;
    FILE *file = fopen("/proc/uptime", "r");
    sysinfo(&info);
    (void)!fscanf(file, "%lf", &seconds);
    long now = ns(CLOCK_BOOTTIME, 0) / 1000000000;
    say("%d %d", now - info.uptime <= 1, now - (long)seconds <= 1);
}

static void unique(void)
{
    char text[2][64] = {{0}};
    for (int i = 0; i < 2; i++) {
        FILE *file = fopen("/proc/sys/kernel/random/uuid", "r");
        (void)!fgets(text[i], 64, file);
        fclose(file);
    }
    say("%d %c %d %.36s", (int)strlen(text[0]), text[0][14], !strcmp(text[0], text[1]), text[0]);
}

static void terminal(void)
{
    const char *found = ttyname(port);
    say("%d", found && !strcmp(found, path));
}

/* Asks over and over for what is there: the end of the wait is that of a wait. */
static void asks(void)
{
    int there = 0, before = 0, calls = 0;
    struct pollfd one = {port, POLLIN, 0};
    tcflush(port, TCIFLUSH);
    poll(&one, 1, -1);
    nap(60);
    tcflush(port, TCIFLUSH);
    long begin = ns(CLOCK_MONOTONIC, 0);
    while (!there) {
        ioctl(port, FIONREAD, &there);
        calls++;
    }
    long first = ns(CLOCK_MONOTONIC, 0);
    before = there;
    while (there == before) {
        ioctl(port, FIONREAD, &there);
        calls++;
    }
    long gap = (ns(CLOCK_MONOTONIC, 0) - first) / 1000;
    say("%d %d %d", first - begin < 60000000, calls < 500, gap > 1000 && gap < 1100);
}

/* A lock of an open file, for which the kernel waits. */
static void outside_lock(void)
{
    struct flock all = {.l_type = F_WRLCK};
    FILE *file = tmpfile();
    char again[32];
    fcntl(fileno(file), F_OFD_SETLKW, &all);
    snprintf(again, sizeof again, "/proc/self/fd/%d", fileno(file));
    if (!fork()) {
        int fd = open(again, O_RDWR);
        fcntl(fd, F_OFD_SETLKW, &all);
        say("has it");
        _exit(0);
    }
    nap(200);
    all.l_type = F_UNLCK;
    fcntl(fileno(file), F_OFD_SETLKW, &all);
    wait(0);
}

static int polled(int fd, int events)
{
    struct pollfd one = {fd, events, 0};
    return poll(&one, 1, 0);
}

/* A file that was looked at is closed when its owner closes it. */
static void pipe_ends(void)
{
    int ends[2];
    char byte;
    pipe(ends);
    int writable = polled(ends[1], POLLOUT), readable = polled(ends[0], POLLIN);
    if (!fork()) {
        usleep(20000);
        write(ends[1], "x", 1);
        usleep(20000);
        _exit(0);
    }
    close(ends[1]);
    long first = read(ends[0], &byte, 1), second = read(ends[0], &byte, 1);
    say("%d %d, %ld %ld", writable, readable, first, second);
}

/* Another file takes its number. */
static void replaced(void)
{
    int one[2], other[2];
    char byte = '-';
    pipe(one);
    pipe(other);
    write(other[1], "y", 1);
    int before = polled(one[0], POLLIN);
    dup2(other[0], one[0]);
    int after = polled(one[0], POLLIN);
    read(one[0], &byte, 1);
    say("%d %d %c", before, after, byte);
}

/* What came before and after the port was put into a set. */
static void epoll(void)
{
    int set = epoll_create1(0), waiting;
    struct epoll_event event = {.events = EPOLLIN};
    char bytes[200];
    tcflush(port, TCIFLUSH);
    usleep(150000);
    ioctl(port, FIONREAD, &waiting);
    epoll_ctl(set, EPOLL_CTL_ADD, port, &event);
    int first = epoll_wait(set, &event, 1, 0);
    long len = read(port, bytes, sizeof bytes);
    int none = epoll_wait(set, &event, 1, 0), second = epoll_wait(set, &event, 1, 500);
    say("%d %d %d, %d %d", waiting > 0, first, len >= waiting, none, second);
}

/* A port that was looked at and is closed by the last that has it is closed: what was unread is gone.
   The parent process has closed it as well. */
static void reopened(void)
{
    struct pollfd one = {port, POLLIN, 0};
    int waiting, fd;
    tcflush(port, TCIFLUSH);
    poll(&one, 1, 1000);
    usleep(30000);
    int before = polled(port, POLLIN);
    close(port);
    fd = open(path, O_RDWR | O_NOCTTY);
    ioctl(fd, FIONREAD, &waiting);
    say("%d %d %d", before, waiting > 0, polled(fd, POLLOUT));
}

/* The signals of an open file are others from now on, at its copies as well. */
static void file_of_others(void)
{
    sigset_t one, other;
    sigemptyset(&one);
    sigaddset(&one, SIGUSR1);
    sigemptyset(&other);
    sigaddset(&other, SIGUSR2);
    hold(SIGUSR1, SIG_BLOCK);
    hold(SIGUSR2, SIG_BLOCK);
    int fd = signalfd(-1, &one, 0), copy = dup(fd);
    kill(getpid(), SIGUSR2);
    int before = polled(fd, POLLIN) + polled(copy, POLLIN);
    signalfd(fd, &other, 0);
    say("%d %d %d", before, polled(fd, POLLIN), polled(copy, POLLIN));
}

/* Files that were not opened for it, or are no files of that kind, fail at once. */
static void wrong_way(void)
{
    char bytes[8] = {0};
    int ends[2], bad = 0, invalid = 0, timer = timerfd_create(CLOCK_MONOTONIC, 0);
    int in = open(path, O_WRONLY | O_NOCTTY), out = open(path, O_RDONLY | O_NOCTTY);
    pipe(ends);
    int readers[] = {ends[1], in, dup(in), open(path, O_PATH), open("/dev/urandom", O_WRONLY)};
    int writers[] = {ends[0], out, dup(out), open(path, O_PATH)};
    for (int i = 0; i < 5; i++) bad += read(readers[i], bytes, 8) == -1 && errno == EBADF;
    for (int i = 0; i < 4; i++) bad += write(writers[i], bytes, 8) == -1 && errno == EBADF;
    invalid += read(epoll_create1(0), bytes, 8) == -1 && errno == EINVAL;
    invalid += write(timer, bytes, 8) == -1 && errno == EINVAL;
    invalid += read(timer, bytes, 4) == -1 && errno == EINVAL;
    invalid += read(eventfd(0, 0), bytes, 4) == -1 && errno == EINVAL;
    int none = recv(ends[0], bytes, 8, 0) == -1 && errno == ENOTSOCK;
    say("%d %d %d %ld", bad, invalid, none, (long)read(ends[0], bytes, 0));
}

/* Looks at many files, each of them fruitless or not all of it, are no wait. */
static void scans(void)
{
    int ends[2], copies[40];
    struct pollfd many[20];
    char byte;
    pipe(ends);
    fcntl(ends[0], F_SETFL, O_NONBLOCK);
    for (int i = 0; i < 20; i++) many[i] = (struct pollfd){500 + i, POLLIN, 0};
    many[19] = (struct pollfd){ends[1], POLLOUT, 0};
    long begin = ms();
    for (int i = 0; i < 200; i++) {
        read(ends[0], &byte, 1);
        poll(many, 20, 0);
    }
    long first = ms() - begin;
    for (int i = 0; i < 40; i++) copies[i] = dup(ends[0]);
    begin = ms();
    for (int i = 0; i < 400; i++) polled(copies[i % 40], POLLIN);
    say("%d %d", first < 20, ms() - begin < 20);
}

/* What came is there for a call of which the supervisor knows nothing. */
static void kernel_reads(void)
{
    char *low = mmap(0, 4096, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_32BIT, -1, 0);
    long len = 3;
    struct pollfd one = {port, POLLIN, 0};
    tcflush(port, TCIFLUSH);
    poll(&one, 1, 1000);
    __asm__ volatile("int $0x80" : "+a"(len) : "b"(port), "c"(low), "d"(1) : "memory");
    say("%ld %d", len, *low != 0);
}

/* A signal tells of each byte that comes (fcntl(2), O_ASYNC), until that is turned off. */
static void asynchronous(void)
{
    sigset_t none;
    sigemptyset(&none);
    handle(SIGIO, counts, 0);
    hold(SIGIO, SIG_BLOCK);
    fcntl(port, F_SETOWN, getpid());
    fcntl(port, F_SETFL, O_ASYNC);
    sigsuspend(&none);
    int first = count;
    hold(SIGIO, SIG_UNBLOCK);
    for (long begin = ms(); ms() - begin < 300;) nap(10);
    int more = count;
    fcntl(port, F_SETFL, 0);
    for (long begin = ms(); ms() - begin < 300;) nap(10);
    say("%d %d %d", first, more > 20, count - more);
}

static int is_signalled(void)
{
    int before = count;
    for (long begin = ms(); ms() - begin < 300;) nap(10);
    return count - before > 20;
}

/* Neither the closing of other files nor that of one of two copies ends them. */
static void asynchronous_copy(void)
{
    int copy = dup(port);
    handle(SIGIO, counts, 0);
    fcntl(port, F_SETOWN, getpid());
    fcntl(port, F_SETFL, O_ASYNC);
    syscall(SYS_close_range, 200, 210, 0);
    dup2(port, port);
    dup2(250, port);
    int first = is_signalled();
    close(port);
    int then = is_signalled();
    fcntl(copy, F_SETFL, 0);
    say("%d %d %d", first, then, is_signalled());
}

/* Another signal than SIGIO tells of which file it is, and that bytes came. */
static void asynchronous_rt(void)
{
    handle(SIGRTMIN + 1, counts, 0);
    fcntl(port, F_SETOWN, getpid());
    fcntl(port, F_SETSIG, SIGRTMIN + 1);
    fcntl(port, F_SETFL, O_ASYNC);
    int is_heard = is_signalled();
    fcntl(port, F_SETFL, 0);
    fcntl(port, F_SETSIG, 0);
    say("%d %d %d", is_heard, code == POLL_IN, value == port);
}

/* A timer goes on at a copy of its file; the number that it had is another file's now. */
static void timer_copy(void)
{
    struct itimerspec soon = {.it_value = {0, 20000000}};
    int ends[2], timer = timerfd_create(CLOCK_MONOTONIC, 0), copy = dup(timer);
    uint64_t count = 0;
    char byte = '-';
    long begin = ms();
    timerfd_settime(timer, 0, &soon, 0);
    close(timer);
    pipe(ends);
    write(ends[1], "xy", 2);
    long len = read(ends[0], &byte, 1), then = read(copy, &count, 8);
    say("%d %ld %c, %ld %d after %ld ms", ends[0] == timer, len, byte, then, (int)count, since(begin));
}

/* It goes on in another program as well. */
static void timer_exec(void)
{
    struct itimerspec soon = {.it_value = {0, 20000000}};
    int timer = timerfd_create(CLOCK_MONOTONIC, 0);
    dup2(timer, 7);
    timerfd_settime(7, 0, &soon, 0);
    execl("/bin/sh", "sh", "-c", "head -c 8 <&7 | wc -c | sed 's/^ */timer-exec: /'", (char *)0);
}

/* In a process that has it from another one, which has ended or has closed it. */
static void timer_child(void)
{
    struct itimerspec soon = {.it_value = {0, 50000000}};
    int ends[2], timer;
    uint64_t count = 0;
    char len = 0;
    long begin = ms();
    pipe(ends);
    if (!fork()) {
        timer = timerfd_create(CLOCK_MONOTONIC, 0);
        timerfd_settime(timer, 0, &soon, 0);
        if (fork()) _exit(0);
        nap(10);
        len = read(timer, &count, 8);
        write(ends[1], &len, 1);
        _exit(0);
    }
    read(ends[0], &len, 1);
    long first = since(begin);
    char left = len;
    begin = ms();
    timer = timerfd_create(CLOCK_MONOTONIC, 0);
    timerfd_settime(timer, 0, &soon, 0);
    if (!fork()) {
        nap(10);
        len = read(timer, &count, 8);
        write(ends[1], &len, 1);
        _exit(0);
    }
    close(timer);
    read(ends[0], &len, 1);
    say("%d after %ld ms, %d after %ld ms", left, first, len, since(begin));
}

/* Kinds of notice 0 to 5 of timer_create; 3 and 5 are none. */
static void timer_kinds(void)
{
    int made[6], id;
    for (int kind = 0; kind < 6; kind++) {
        struct sigevent event = {.sigev_signo = SIGUSR1, .sigev_notify = kind};
        ((int *)&event)[4] = getpid();
        made[kind] = !syscall(SYS_timer_create, CLOCK_MONOTONIC, &event, &id);
    }
    say("%d %d %d %d %d %d", made[0], made[1], made[2], made[3], made[4], made[5]);
}

/* Another thread changes what will be asked for next while a poll waits: that is not undone. */
static struct pollfd shared[2];

static void *asks_for_another(void *to)
{
    nap(20);
    shared[1].fd = 77;
    nap(20);
    write(*(int *)to, "x", 1);
    return 0;
}

static void poll_shared(void)
{
    int ends[2], others[2];
    pthread_t thread;
    pipe(ends);
    pipe(others);
    shared[0] = (struct pollfd){ends[0], POLLIN, 0};
    shared[1] = (struct pollfd){others[0], POLLIN, 99};
    pthread_create(&thread, 0, asks_for_another, &ends[1]);
    int ready = poll(shared, 2, 1000);
    say("%d %d, %d %d", ready, shared[0].revents, shared[1].fd, shared[1].revents);
}

/* Libraries look for the driver of a port before they open it. */
static void entry(void)
{
    char entry[300], driver[100];
    struct stat status;
    snprintf(entry, sizeof entry, "/sys/class/tty/%s", getenv("HILRIG_TTY_SONAR") + 5);
    int found = lstat(entry, &status);
    say("%d %d %d", found, !found && S_ISLNK(status.st_mode), readlink(entry, driver, 100) > 0);
}

/* The same error over and over is a wait. */
static void errors(void)
{
    long begin = ms(), asked = 0;
    for (; ms() - begin < 1000; asked++) {
        polled(77, POLLIN);
        accept4(-1, 0, 0, 0);
    }
    say("%d", asked < 5000);
}

/* A scheduler that lets others run thousands of times takes little time. */
static void yields(void)
{
    long begin = ms();
    for (int i = 0; i < 5000; i++) sched_yield();
    say("%d", ms() - begin < 200);
}

static const struct {
    const char *name;
    void (*probe)(void);
} probes[] = {
    {"rt-raise", rt_raise},
    {"rt-highest", rt_highest},
    {"rt-value", rt_value},
    {"rt-held-while-handled", rt_held_while_handled},
    {"rt-nodefer", rt_nodefer},
    {"rt-altstack", rt_altstack},
    {"rt-restart", rt_restart},
    {"rt-interrupts", rt_interrupts},
    {"rt-ignored", rt_ignored},
    {"rt-waited", rt_waited},
    {"rt-default", rt_default},
    {"rt-registers", rt_registers},
    {"rt-longjmp", rt_longjmp},
    {"rt-timer", rt_timer},
    {"rt-suspend", rt_suspend},
    {"rt-ppoll", rt_ppoll},
    {"rt-file", rt_file},
    {"cancel", cancel},
    {"drops-rights", drops_rights},
    {"stops", stops},
    {"mq", mq},
    {"mq-times-out", mq_times_out},
    {"mq-full", mq_full},
    {"msg", msg},
    {"msg-nowait", msg_nowait},
    {"msg-full", msg_full},
    {"msg-removed", msg_removed},
    {"sem", sem},
    {"sem-times-out", sem_times_out},
    {"sem-zero", sem_zero},
    {"sem-undone", sem_undone},
    {"pi-thread", pi_thread},
    {"pi-process", pi_process},
    {"pi-times-out", pi_times_out},
    {"pi-robust", pi_robust},
    {"pi-condition", pi_condition},
    {"event", event},
    {"socket-times-out", socket_times_out},
    {"timer-file", timer_file},
    {"looks", looks},
    {"calendar", calendar},
    {"processor-time", processor_time},
    {"uptime", uptime},
    {"unique", unique},
    {"terminal", terminal},
    {"asks", asks},
    {"pipe-ends", pipe_ends},
    {"replaced", replaced},
    {"epoll", epoll},
    {"int-0x80", int_0x80},
    /* A port that was closed is as new: no bytes of it are in the kernel before the next probe. */
    {"reopened", reopened},
    {"asynchronous", asynchronous},
    {"asynchronous-copy", asynchronous_copy},
    {"asynchronous-rt", asynchronous_rt},
    {"poll-shared", poll_shared},
    {"kernel-reads", kernel_reads},
    {"file-of-others", file_of_others},
    {"wrong-way", wrong_way},
    {"scans", scans},
    {"timer-copy", timer_copy},
    {"timer-exec", timer_exec},
    {"timer-child", timer_child},
    {"timer-kinds", timer_kinds},
    {"entry", entry},
    {"errors", errors},
    {"yields", yields},
    /* What follows leaves virtual time. */
    {"outside-lock", outside_lock},
};
static const unsigned outside = 1;

static void opens_port(void)
{
    struct termios termios;
    port = open(path, O_RDWR | O_NOCTTY);
    tcgetattr(port, &termios);
    cfmakeraw(&termios);
    cfsetspeed(&termios, B9600);
    tcsetattr(port, TCSANOW, &termios);
}

/* Those whose names begin like one of the words; of those that are only there for some test no word
   is none. */
int main(int argc, char **argv)
{
    path = getenv("HILRIG_PORT_SONAR");
    opens_port();
    const unsigned all = sizeof probes / sizeof *probes;
    for (unsigned i = 0; i < all; i++) {
        int wanted = argc < 2 && i < all - outside;
        name = probes[i].name;
        for (int word = 1; word < argc; word++)
            wanted |= !strncmp(argv[word], name, strlen(argv[word]));
        if (!wanted) continue;
        int child = fork();
        if (!child) {
            probes[i].probe();
            _exit(0);
        }
        int is_last = probes[i].probe == reopened;
        if (is_last) close(port);
        waitpid(child, 0, 0);
        if (is_last) opens_port();
    }
    return 0;
}

# Writes a C program of threads that sleep, wait for each other, pass bytes through pipes and poll, as
# chance has it: python3 generate.py SEED > program.c
#
# What is determined in any order of its threads is said on standard output: how many rounds each
# thread made, the sums that locks guard, the bytes that came through each pipe.
import random
import sys

chance = random.Random(int(sys.argv[1]))
threads = chance.randint(2, 6)
pipes = chance.randint(1, 3)
rounds = chance.randint(3, 25)

# Each pipe has one reader, which is a thread of its own, and as many bytes as are written.
writes = [0] * pipes
bodies = []
for thread in range(threads):
    steps = []
    for _ in range(chance.randint(2, 6)):
        kind = chance.choice(["sleep", "lock", "write", "poll", "condition", "yield", "clock", "try"])
        time = chance.randint(0, 3000)
        if kind == "sleep":
            steps.append(f"nap({time});")
        elif kind == "lock":
            steps.append(f"pthread_mutex_lock(&m); int s{len(steps)} = sum; "
                         f"{'nap(%d); ' % (time // 8) if chance.random() < 0.4 else ''}"
                         f"sum = s{len(steps)} + {thread + 1}; pthread_mutex_unlock(&m);")
        elif kind == "write":
            pipe = chance.randrange(pipes)
            writes[pipe] += rounds
            steps.append(f"if (write(p[{pipe}][1], \"x\", 1) != 1) abort();")
        elif kind == "poll":
            steps.append(f"poll(0, 0, {time // 1000});")
        elif kind == "condition":
            steps.append(f"patient({time});")
            steps.append("pthread_cond_broadcast(&c);")
        elif kind == "yield":
            steps.append("sched_yield();")
        elif kind == "clock":
            steps.append("clock_gettime(CLOCK_MONOTONIC, &(struct timespec){0});")
        else:
            steps.append(f"while (pthread_mutex_trylock(&m)) nap({time // 10 + 1}); sum++; "
                         "pthread_mutex_unlock(&m);")
    bodies.append("".join(f"        {step}\n" for step in steps))

print(r"""#define _GNU_SOURCE
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
static pthread_mutex_t m = PTHREAD_MUTEX_INITIALIZER, n = PTHREAD_MUTEX_INITIALIZER;
static pthread_cond_t c = PTHREAD_COND_INITIALIZER;
static int p[8][2], sum, port;
static void nap(int us) { nanosleep(&(struct timespec){0, us * 1000L}, 0); }
static void patient(int us) {
    struct timespec t;
    clock_gettime(CLOCK_REALTIME, &t);
    t.tv_nsec += us * 1000L;
    if (t.tv_nsec >= 1000000000) t.tv_sec++, t.tv_nsec -= 1000000000;
    pthread_mutex_lock(&n);
    pthread_cond_timedwait(&c, &n, &t);
    pthread_mutex_unlock(&n);
}
static int wanted[8];
static void *reader(void *which) {
    long i = (long)which;
    char b[16];
    int have = 0, len;
    struct pollfd f = {p[i][0], POLLIN, 0};
    while (have < wanted[i]) {
        if (poll(&f, 1, 2) == 0) continue;
        if ((len = read(p[i][0], b, sizeof b)) <= 0) abort();
        have += len;
        dprintf(port, "%ld", i);
    }
    return (void *)(long)have;
}""")
for thread, body in enumerate(bodies):
    print(f"static void *thread{thread}(void *x) {{\n    long i = 0;\n"
          f"    for (; i < {rounds}; i++) {{\n{body}        dprintf(port, \"{chr(97 + thread)}\");\n"
          "    }\n    return (void *)i;\n}")
print("int main(void) {\n    pthread_t t[16], r[8];\n    void *end;\n"
      "    port = open(getenv(\"HILRIG_PORT_SONAR\"), O_WRONLY | O_NOCTTY);")
for pipe in range(pipes):
    print(f"    if (pipe(p[{pipe}])) abort();\n    wanted[{pipe}] = {writes[pipe]};")
    print(f"    pthread_create(&r[{pipe}], 0, reader, (void *){pipe}L);")
for thread in range(threads):
    print(f"    pthread_create(&t[{thread}], 0, thread{thread}, 0);")
for thread in range(threads):
    print(f"    pthread_join(t[{thread}], &end);\n"
          f"    printf(\"thread {thread}: %ld rounds\\n\", (long)end);")
for pipe in range(pipes):
    print(f"    pthread_join(r[{pipe}], &end);\n    printf(\"pipe {pipe}: %ld bytes\\n\", (long)end);")
print("    int status;\n    if (fork() == 0) { nap(500); _exit(sum & 63); }\n"
      "    wait(&status);\n"
      "    printf(\"sum %d, child %d\\n\", sum, WEXITSTATUS(status) == (sum & 63));\n"
      "    fflush(stdout);\n    pause();\n}")

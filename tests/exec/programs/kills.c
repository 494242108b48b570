#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#include <x86intrin.h>
int main(void) {
    open(getenv("HILRIG_PORT_SONAR"), O_RDWR | O_NOCTTY);
    unsigned long before = __rdtsc();
    usleep(2000);
    unsigned long steps = __rdtsc() - before;
    pid_t child = fork();
    if (child == 0) for (;;) pause();
    usleep(1000);
    kill(child, SIGKILL);
    int status, gone = waitpid(child, &status, WNOHANG) == child;
    sigset_t set;
    sigemptyset(&set);
    sigaddset(&set, SIGALRM);
    sigprocmask(SIG_BLOCK, &set, 0);
    struct timespec a, b, limit = {0, 300000000};
    int early = sigtimedwait(&set, 0, &limit);
    alarm(2);
    clock_gettime(CLOCK_MONOTONIC, &a);
    int signal = sigtimedwait(&set, 0, 0);
    clock_gettime(CLOCK_MONOTONIC, &b);
    printf("%d %d %d %d %ld\n", steps >= 2000000 && steps < 2010000, gone, early,
           signal == SIGALRM, (b.tv_sec - a.tv_sec) * 1000 + (b.tv_nsec - a.tv_nsec) / 1000000);
    fflush(stdout);
    sleep(60);
}

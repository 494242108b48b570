/* Reads lines of a port and ends by SIGABRT at more than 150 lines, at more than 5 min, and at the
   word "hurt" if the first argument is "bug". A search whose cases all begin at the first read never
   comes to the first two. The other arguments are how the program cannot be put back there. The
   second argument is the port. */
#include <fcntl.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

static int lines;
static time_t begun;

static time_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return time.tv_sec;
}

static void *rest(void *nothing)
{
    for (;;)
        pause();
    return nothing;
}

int main(int count, char **words)
{
    struct termios raw;
    pthread_t thread;
    char line[64], got;
    int len = 0, port = open(words[2], O_RDWR | O_NOCTTY);
    (void)count;
    if (port < 0 || tcgetattr(port, &raw))
        return 2;
    cfmakeraw(&raw);
    tcsetattr(port, TCSANOW, &raw);
    if (!strcmp(words[1], "thread") && pthread_create(&thread, NULL, rest, NULL))
        return 2;
    if (!strcmp(words[1], "file") && open(words[0], O_RDONLY) < 0)
        return 2;
    if (!strcmp(words[1], "child") && fork() == 0)
        rest(NULL);
    begun = now();
    while (read(port, &got, 1) == 1) {
        if (got != '\n') {
            if (len < 63)
                line[len++] = got;
            continue;
        }
        line[len] = 0;
        len = 0;
        if (!strcmp(words[1], "grows"))
            memset(malloc(300000), 1, 300000);
        if (++lines > 150 || now() - begun > 300)
            abort();
        if (!strcmp(words[1], "bug") && strstr(line, "hurt"))
            abort();
    }
    return 0;
}

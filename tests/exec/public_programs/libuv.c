/* A client by libuv: polls the port, prints what comes, sends "ping" when a timer expires. */
#include <fcntl.h>
#include <stdio.h>
#include <termios.h>
#include <unistd.h>
#include <uv.h>

static int port, count;

static void ready(uv_poll_t *poll, int status, int events)
{
    char bytes[100];
    ssize_t len = read(port, bytes, sizeof bytes);
    (void)status, (void)events;
    if (len > 0) fwrite(bytes, 1, len, stdout), fflush(stdout);
    if ((count += len > 0 ? len : 0) >= 200) uv_poll_stop(poll);
}

static void ping(uv_timer_t *timer)
{
    (void)timer;
    if (write(port, "ping\r\n", 6) != 6) perror("write");
}

int main(int argc, char **words)
{
    struct termios raw;
    uv_poll_t poll;
    uv_timer_t timer;
    port = argc > 1 ? open(words[1], O_RDWR | O_NOCTTY | O_NONBLOCK) : -1;
    if (port < 0 || tcgetattr(port, &raw)) return 1;
    cfmakeraw(&raw);
    cfsetspeed(&raw, B9600);
    tcsetattr(port, TCSANOW, &raw);
    uv_poll_init(uv_default_loop(), &poll, port);
    uv_poll_start(&poll, UV_READABLE, ready);
    uv_timer_init(uv_default_loop(), &timer);
    uv_timer_start(&timer, ping, 1000, 0);
    return uv_run(uv_default_loop(), UV_RUN_DEFAULT);
}

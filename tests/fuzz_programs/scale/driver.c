/* A driver of the scale, which gives up after five tries. With CARELESS it does not verify the
   checksum of replies. With POLLS it sends one and the same request, every 400 ms, and repeats it
   at once; with COUNTS only the counter tells the next request from a repeated one. */
#include <fcntl.h>
#include <poll.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

static int port;

/* The number of received bytes, up to four; a silence of 200 ms ends a reply. */
static int receive(uint8_t *reply)
{
    int len = 0;
    struct pollfd wait = { port, POLLIN, 0 };
    while (len < 4 && poll(&wait, 1, 200) > 0) {
        int count = (int)read(port, reply + len, 4 - (size_t)len);
        if (count <= 0)
            exit(4);
        len += count;
    }
    return len;
}

int main(int count, char **words)
{
    struct termios settings;
    uint8_t what = 1, tag = 0, reply[4];
    port = open(words[count - 1], O_RDWR | O_NOCTTY);
    if (port < 0 || tcgetattr(port, &settings))
        return 2;
    cfmakeraw(&settings);
    cfsetspeed(&settings, B9600);
    tcsetattr(port, TCSANOW, &settings);
    for (int tries = 0; tries < 5; tries++) {
#ifndef POLLS
#ifdef COUNTS
        tag += tries == 0;
#else
        tag++;
#endif
#endif
        uint8_t request[4] = { 0x55, what, tag, (uint8_t)(0x55 + what + tag) };
        if (write(port, request, 4) != 4)
            exit(4);
        int is_whole = receive(reply) == 4 && reply[0] == 0x55 && reply[1] == 0x81;
#ifdef CARELESS
        int is_sound = 1;
#else
        int is_sound = reply[3] == (uint8_t)(reply[0] + reply[1] + reply[2]);
#endif
        if (is_whole && is_sound && reply[2] == tag) {
            tries = -1;
#ifdef POLLS
            usleep(400000);
#else
#ifndef COUNTS
            what = 3 - what;
#endif
            usleep(50000);
        } else {
            usleep(200000);
#endif
            tcflush(port, TCIFLUSH);
        }
    }
    fprintf(stderr, "no reply\n");
    return 3;
}

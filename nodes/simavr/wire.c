/* Messages of the rig, binary form: u32 length, u8 type, body; little endian. */
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "node.h"

/* An exchange has at most 65,535 items of 64 KiB a port; the greeting is a few KiB. */
static const uint32_t MESSAGE_MAX = 64u << 20;

static int in_fd, out_fd;
static uint8_t *in_buffer;
static size_t in_start, in_len, in_size;
static uint8_t *out_buffer;
static size_t out_len, out_size;
static uint16_t item_count;

static void put(uint8_t *to, uint64_t value, int bytes) {
    for (int i = 0; i < bytes; i++)
        to[i] = (uint8_t)(value >> 8 * i);
}

static uint64_t get(const uint8_t *from, int bytes) {
    uint64_t value = 0;
    for (int i = bytes; i-- > 0;)
        value = value << 8 | from[i];
    return value;
}

bool wire_is_gone(void) {
    /* What the rig has written before is of no use any more either. */
    struct pollfd both[2] = {{.fd = in_fd}, {.fd = out_fd}};
    return poll(both, 2, 0) > 0 && ((both[0].revents | both[1].revents) & (POLLHUP | POLLERR));
}

uint64_t wire_u64(const uint8_t *from) { return get(from, 8); }

double wire_f64(const uint8_t *from) {
    uint64_t bits = get(from, 8);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void grow(uint8_t **buffer, size_t *size, size_t wanted) {
    if (wanted <= *size)
        return;
    *size = wanted + 65536;
    *buffer = realloc(*buffer, *size);
    if (!*buffer)
        refuse("no memory for a message of %zu bytes", wanted);
}

/* Whether `wanted` bytes are there; not at the end of the input. */
static bool fill(size_t wanted) {
    if (in_start > 0 && in_len < wanted) {
        memmove(in_buffer, in_buffer + in_start, in_len);
        in_start = 0;
    }
    grow(&in_buffer, &in_size, in_start + wanted);
    while (in_len < wanted) {
        size_t end = in_start + in_len;
        ssize_t got = read(in_fd, in_buffer + end, in_size - end);
        if (got < 0 && errno == EINTR)
            continue;
        if (got <= 0)
            return false;
        in_len += (size_t)got;
    }
    return true;
}

static void drop(size_t count) {
    in_start += count;
    in_len -= count;
    if (in_len == 0)
        in_start = 0;
}

void wire_begin(int in, int out) {
    in_fd = in;
    out_fd = out;
    if (!fill(4))
        refuse("no request of a rig on standard input; hilrig starts this program by itself");
    if (in_buffer[in_start] == '{')
        refuse("speaks the binary form only (HRN1); leave out --json-nodes");
    if (memcmp(in_buffer + in_start, "HRN1", 4) != 0)
        refuse("the request begins with neither HRN1 nor {; update hilrig and nodes/simavr together");
    drop(4);
}

int wire_read(const uint8_t **body, uint32_t *len) {
    static size_t last;
    drop(last);
    last = 0;
    if (!fill(5))
        return 0;
    uint32_t size = (uint32_t)get(in_buffer + in_start, 4);
    if (size < 1 || size > MESSAGE_MAX)
        refuse("a request of %u bytes; expected 1 to %u", size, MESSAGE_MAX);
    if (!fill(4 + (size_t)size))
        return 0;
    last = 4 + (size_t)size;
    *body = in_buffer + in_start + 5;
    *len = size - 1;
    return in_buffer[in_start + 4];
}

static void write_all(const uint8_t *bytes, size_t len) {
    while (len > 0) {
        ssize_t wrote = write(out_fd, bytes, len);
        if (wrote < 0 && errno == EINTR)
            continue;
        /* The rig is gone. */
        if (wrote <= 0)
            exit(0);
        bytes += wrote;
        len -= (size_t)wrote;
    }
}

void wire_send(uint8_t type, const void *body, uint32_t len) {
    grow(&out_buffer, &out_size, 5 + (size_t)len);
    put(out_buffer, len + 1, 4);
    out_buffer[4] = type;
    if (len > 0)
        memcpy(out_buffer + 5, body, len);
    write_all(out_buffer, 5 + (size_t)len);
}

/* Length, type, next, count. */
enum { ANSWER_HEAD = 4 + 1 + 8 + 2, ITEM_HEAD = 1 + 1 + 2 + 8 };

void wire_clear(void) {
    out_len = ANSWER_HEAD;
    item_count = 0;
    grow(&out_buffer, &out_size, out_len);
}

void wire_item(uint8_t kind, uint8_t port, uint64_t at_ns, const void *payload, size_t len) {
    if (item_count == UINT16_MAX || len > UINT16_MAX)
        refuse("an answer of more than %u items, or an item of %zu bytes; choose a shorter slice_us",
               UINT16_MAX, len);
    grow(&out_buffer, &out_size, out_len + ITEM_HEAD + len);
    uint8_t *to = out_buffer + out_len;
    to[0] = kind;
    to[1] = port;
    put(to + 2, len, 2);
    put(to + 4, at_ns, 8);
    memcpy(to + ITEM_HEAD, payload, len);
    out_len += ITEM_HEAD + len;
    item_count++;
}

void wire_answer(uint64_t next_ns) {
    put(out_buffer, out_len - 4, 4);
    out_buffer[4] = 'x';
    put(out_buffer + 5, next_ns, 8);
    put(out_buffer + 13, item_count, 2);
    write_all(out_buffer, out_len);
}

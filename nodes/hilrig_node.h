/* A node of hilrig in C: one header, no library but libc.
 *
 *   #define HILRIG_NODE_IMPLEMENTATION
 *   #include "hilrig_node.h"
 *
 *   static void receive(hrn_node *node, uint8_t port, uint64_t at, const uint8_t *data, size_t len)
 *   {
 *       hrn_send(node, port, at + 1000000, data, len);       an echo, 1 ms later
 *   }
 *   int main(void)
 *   {
 *       hrn_node node = { .receive = receive };
 *       return hrn_main(&node);
 *   }
 *
 * Times are nanoseconds since the run began. The node must not look at the clock of the computer:
 * time passes in the rig alone. Standard output belongs to the protocol, so print to stderr.
 * The contract is docs/nodes.md. C99.
 */
#ifndef HILRIG_NODE_H
#define HILRIG_NODE_H

#include <stddef.h>
#include <stdint.h>

#define HRN_VERSION 1
/* Asked again only after something has happened. */
#define HRN_NEVER UINT64_MAX

/* What a line tells besides bytes. */
enum { HRN_OPENED, HRN_CLOSED, HRN_BREAK, HRN_FRAMING_ERROR, HRN_PARITY_ERROR, HRN_OVERRUN };

typedef struct hrn_node hrn_node;

struct hrn_node {
    /* Any of these may be null. */

    /* The rig's greeting, JSON text of `len` bytes: settings, ports, seed. */
    void (*start)(hrn_node *node, const char *hello, size_t len);
    /* Bytes that arrived, the last one complete at `at`. */
    void (*receive)(hrn_node *node, uint8_t port, uint64_t at, const uint8_t *data, size_t len);
    /* The far end opened or closed its port, or held the line low. */
    void (*line)(hrn_node *node, uint8_t port, uint64_t at, int event);
    /* A fault begins or ends; `figure` is not a number if there is none. */
    void (*fault)(hrn_node *node, uint64_t at, const char *name, int begins, double figure);
    /* A value that the rig gives. */
    void (*quantity)(hrn_node *node, uint8_t index, uint64_t at, double value);
    /* After all that has happened by `now`; when to be asked again. */
    uint64_t (*poll)(hrn_node *node, uint64_t now);
    /* All state: points `data` at it, returns its length. */
    size_t (*save)(hrn_node *node, const uint8_t **data);
    void (*load)(hrn_node *node, const uint8_t *data, size_t len);

    /* Names of faults and of values that the node gives, as the inside of a JSON list:
     * "\"stuck\", \"slow\"". Null: none. */
    const char *faults;
    const char *outputs;
    /* The node's own data. */
    void *data;

    /* Kept by the header. */
    uint64_t now;
    uint8_t *out;
    size_t out_len, out_room;
    uint16_t out_count;
};

/* Sends bytes, not before `at`; a time in the past means now. */
void hrn_send(hrn_node *node, uint8_t port, uint64_t at, const void *data, size_t len);
/* Tells the far end HRN_OPENED, HRN_CLOSED or HRN_BREAK. */
void hrn_line(hrn_node *node, uint8_t port, uint64_t at, int event);
/* An entry of the log. */
void hrn_note(hrn_node *node, const char *rule, const char *sentence);
/* The master broke a rule. */
void hrn_violation(hrn_node *node, const char *rule, const char *sentence);
/* A value of `outputs`, by its place. */
void hrn_show(hrn_node *node, uint8_t index, double value);
/* Plays the node on standard input and output until the rig ends it; the exit code. */
int hrn_main(hrn_node *node);

#ifdef HILRIG_NODE_IMPLEMENTATION

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

/* Longest message, and longest payload of an item. */
#define HRN_MESSAGE_MAX ((size_t)16 << 20)
#define HRN_ITEM_MAX ((size_t)0xFFFF)

/* Ends the process: an answer that is cut would be another one. */
static void hrn_refuse(const char *what)
{
    fprintf(stderr, "hilrig_node: %s\n", what);
    exit(1);
}

static uint64_t hrn_get(const uint8_t *from, int bytes)
{
    uint64_t value = 0;
    while (bytes-- > 0)
        value = value << 8 | from[bytes];
    return value;
}

static void hrn_room(hrn_node *node, size_t len)
{
    if (len > HRN_MESSAGE_MAX || node->out_len + len > HRN_MESSAGE_MAX)
        hrn_refuse("an answer is longer than 16 MiB");
    if (node->out_len + len <= node->out_room)
        return;
    node->out_room = 2 * (node->out_len + len) + 256;
    node->out = realloc(node->out, node->out_room);
    if (!node->out)
        hrn_refuse("no memory");
}

static void hrn_put(hrn_node *node, uint64_t value, int bytes)
{
    hrn_room(node, 8);
    for (int i = 0; i < bytes; i++)
        node->out[node->out_len++] = (uint8_t)(value >> 8 * i);
}

static void hrn_bytes(hrn_node *node, const void *data, size_t len)
{
    hrn_room(node, len);
    if (len > 0)
        memcpy(node->out + node->out_len, data, len);
    node->out_len += len;
}

/* The head of an item; its payload of `len` bytes follows. */
static void hrn_item(hrn_node *node, int kind, int port, uint64_t at, size_t len)
{
    if (node->out_count == UINT16_MAX)
        hrn_refuse("more than 65535 items in one answer");
    node->out_count++;
    hrn_put(node, (uint64_t)kind, 1);
    hrn_put(node, (uint64_t)port, 1);
    hrn_put(node, len, 2);
    hrn_put(node, at < node->now ? node->now : at, 8);
}

void hrn_send(hrn_node *node, uint8_t port, uint64_t at, const void *data, size_t len)
{
    const uint8_t *from = data;
    while (len > 0) {
        size_t part = len < HRN_ITEM_MAX ? len : HRN_ITEM_MAX;
        hrn_item(node, 1, port, at, part);
        hrn_bytes(node, from, part);
        from += part;
        len -= part;
    }
}

void hrn_line(hrn_node *node, uint8_t port, uint64_t at, int event)
{
    hrn_item(node, 2, port, at, 1);
    hrn_put(node, (uint64_t)event, 1);
}

static void hrn_log(hrn_node *node, int kind, const char *rule, const char *sentence)
{
    size_t rule_len = strlen(rule), len = strlen(sentence);
    if (rule_len == 0 || rule_len > 255)
        hrn_refuse("the name of a rule has 1 to 255 characters");
    /* The end of a long sentence is left out. */
    if (len > HRN_ITEM_MAX - rule_len - 1)
        len = HRN_ITEM_MAX - rule_len - 1;
    hrn_item(node, kind, 0, node->now, rule_len + 1 + len);
    hrn_bytes(node, rule, rule_len + 1);
    hrn_bytes(node, sentence, len);
}

void hrn_note(hrn_node *node, const char *rule, const char *sentence)
{
    hrn_log(node, 3, rule, sentence);
}

void hrn_violation(hrn_node *node, const char *rule, const char *sentence)
{
    hrn_log(node, 4, rule, sentence);
}

void hrn_show(hrn_node *node, uint8_t index, double value)
{
    uint64_t bits;
    memcpy(&bits, &value, 8);
    hrn_item(node, 5, index, node->now, 8);
    hrn_put(node, bits, 8);
}

static double hrn_number(const uint8_t *from)
{
    uint64_t bits = hrn_get(from, 8);
    double value;
    memcpy(&value, &bits, 8);
    return value;
}

/* A request comes with one read, however long it is. */
static uint8_t hrn_in[1 << 16];
static size_t hrn_in_at, hrn_in_len;

static int hrn_read(uint8_t *to, size_t len)
{
    while (len > 0) {
        if (hrn_in_at == hrn_in_len) {
            ssize_t got = read(0, hrn_in, sizeof hrn_in);
            if (got < 0 && errno == EINTR)
                continue;
            if (got <= 0)
                return 0;
            hrn_in_at = 0;
            hrn_in_len = (size_t)got;
        }
        size_t part = hrn_in_len - hrn_in_at;
        if (part > len)
            part = len;
        memcpy(to, hrn_in + hrn_in_at, part);
        hrn_in_at += part;
        to += part;
        len -= part;
    }
    return 1;
}

/* Writes a message of this type, whose body is what was put since `hrn_begin`. */
static void hrn_begin(hrn_node *node, char kind)
{
    node->out_len = 0;
    node->out_count = 0;
    hrn_put(node, 0, 4);
    hrn_put(node, (uint8_t)kind, 1);
}

static int hrn_finish(hrn_node *node)
{
    size_t len = node->out_len - 4, done = 0;
    for (int i = 0; i < 4; i++)
        node->out[i] = (uint8_t)(len >> 8 * i);
    while (done < node->out_len) {
        ssize_t put = write(1, node->out + done, node->out_len - done);
        if (put < 0 && errno == EINTR)
            continue;
        if (put <= 0)
            return 0;
        done += (size_t)put;
    }
    return 1;
}

static void hrn_happen(hrn_node *node, const uint8_t *item, size_t len)
{
    uint8_t kind = item[0], port = item[1];
    uint64_t at = hrn_get(item + 4, 8);
    const uint8_t *body = item + 12;
    if (kind == 1 && node->receive)
        node->receive(node, port, at, body, len);
    if (kind == 2 && node->line && len == 1)
        node->line(node, port, at, body[0]);
    if (kind == 3 && node->fault && len >= 9) {
        char name[256] = {0};
        /* A longer name is none that the node gave. */
        if (len - 9 >= sizeof name)
            return;
        memcpy(name, body + 9, len - 9);
        node->fault(node, at, name, body[0], hrn_number(body + 1));
    }
    if (kind == 4 && node->quantity && len == 8)
        node->quantity(node, port, at, hrn_number(body));
}

/* One exchange; false if the request cannot be read. */
static int hrn_exchange(hrn_node *node, const uint8_t *body, size_t len)
{
    if (len < 10)
        return 0;
    node->now = hrn_get(body, 8);
    hrn_begin(node, 'x');
    hrn_put(node, HRN_NEVER, 8);
    hrn_put(node, 0, 2);
    size_t at = 10;
    for (uint64_t count = hrn_get(body + 8, 2); count > 0; count--) {
        if (len - at < 12 || len - at - 12 < hrn_get(body + at + 2, 2))
            return 0;
        size_t size = (size_t)hrn_get(body + at + 2, 2);
        hrn_happen(node, body + at, size);
        at += 12 + size;
    }
    uint64_t next = node->poll ? node->poll(node, node->now) : HRN_NEVER;
    if (next < node->now)
        next = node->now;
    for (int i = 0; i < 8; i++)
        node->out[5 + i] = (uint8_t)(next >> 8 * i);
    for (int i = 0; i < 2; i++)
        node->out[13 + i] = (uint8_t)(node->out_count >> 8 * i);
    return hrn_finish(node);
}

static int hrn_greet(hrn_node *node, const uint8_t *body, size_t len)
{
    const char *faults = node->faults ? node->faults : "";
    const char *outputs = node->outputs ? node->outputs : "";
    const char *version = len > 0 ? strstr((const char *)body, "\"hilrig_node\"") : NULL;
    const char *number = version ? strchr(version, ':') : NULL;
    int known = number && atoi(number + 1) == HRN_VERSION;
    hrn_begin(node, 'h');
    char text[64];
    int size = snprintf(text, sizeof text, "{\"hilrig_node\": %d, \"save\": %s, \"faults\": [",
        HRN_VERSION, node->save && node->load ? "true" : "false");
    hrn_bytes(node, text, (size_t)size);
    hrn_bytes(node, faults, strlen(faults));
    hrn_bytes(node, "], \"outputs\": [", strlen("], \"outputs\": ["));
    hrn_bytes(node, outputs, strlen(outputs));
    hrn_bytes(node, "]}", 2);
    if (!hrn_finish(node))
        return 0;
    if (!known) {
        fprintf(stderr, "hilrig_node: the rig speaks another version, expected %d\n", HRN_VERSION);
        return 0;
    }
    if (node->start)
        node->start(node, (const char *)body, len);
    return 1;
}

int hrn_main(hrn_node *node)
{
    uint8_t head[4], *body = NULL;
    size_t room = 0;
    if (!hrn_read(head, 4) || memcmp(head, "HRN1", 4) != 0) {
        fputs("hilrig_node: standard input is no binary stream of hilrig\n", stderr);
        return 1;
    }
    int result = 1;
    while (hrn_read(head, 4)) {
        size_t len = (size_t)hrn_get(head, 4);
        if (len == 0 || len > HRN_MESSAGE_MAX) {
            fprintf(stderr, "hilrig_node: a request of %zu bytes, expected 1 to 16 MiB\n", len);
            break;
        }
        if (len + 1 > room) {
            room = len + 1;
            uint8_t *more = realloc(body, room);
            if (!more)
                break;
            body = more;
        }
        if (!hrn_read(body, len))
            break;
        body[len] = 0;
        if (body[0] == 'E') {
            result = 0;
            break;
        }
        int good = 0;
        if (body[0] == 'H')
            good = hrn_greet(node, body + 1, len - 1);
        if (body[0] == 'X')
            good = hrn_exchange(node, body + 1, len - 1);
        if (body[0] == 'S' && node->save) {
            const uint8_t *state = NULL;
            size_t size = node->save(node, &state);
            hrn_begin(node, 's');
            hrn_bytes(node, state, size);
            good = hrn_finish(node);
        }
        if (body[0] == 'L' && node->load) {
            node->load(node, body + 1, len - 1);
            hrn_begin(node, 'l');
            good = hrn_finish(node);
        }
        if (!good)
            break;
    }
    free(body);
    free(node->out);
    node->out = NULL;
    node->out_len = node->out_room = 0;
    return result;
}

#endif
#endif

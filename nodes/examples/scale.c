/* The device of scale.py in C: a balance that speaks MT-SICS, drifts, and is busy for a second when
 * it zeroes. cc -O2 nodes/examples/scale.c -o scale */
#define HILRIG_NODE_IMPLEMENTATION
#include "../hilrig_node.h"

static struct {
    double load_g, zero_g;
    uint64_t busy_until, zero_at;
    char state, line[64];
    size_t len;
} scale = {.state = 'S', .zero_at = HRN_NEVER};

static void start(hrn_node *node, const char *hello, size_t len)
{
    const char *load = strstr(hello, "\"load_g\":");
    (void)node, (void)len;
    scale.load_g = load ? atof(load + 9) : 0;
}

static double net_g(uint64_t now)
{
    return scale.load_g + 0.01 * (double)(now / 500000000) - scale.zero_g;
}

static void fault(hrn_node *node, uint64_t at, const char *name, int begins, double figure)
{
    (void)node, (void)at, (void)name, (void)figure;
    scale.state = begins ? 'D' : 'S';
}

static void hear(hrn_node *node, uint64_t now, const char *line)
{
    char text[128];
    if (now < scale.busy_until) {
        snprintf(text, sizeof text, "%s came while the scale is busy", line);
        hrn_violation(node, "too-fast", text);
    } else if (strcmp(line, "SI") == 0) {
        hrn_show(node, 0, net_g(now));
        int len = snprintf(text, sizeof text, "S %c %10.2f g\r\n", scale.state, net_g(now));
        if (len > 0 && (size_t)len < sizeof text)
            hrn_send(node, 0, now + 30000000, text, (size_t)len);
    } else if (strcmp(line, "ZI") == 0) {
        scale.busy_until = scale.zero_at = now + 1000000000;
    } else {
        hrn_send(node, 0, now + 30000000, "ES\r\n", 4);
    }
}

static void receive(hrn_node *node, uint8_t port, uint64_t at, const uint8_t *data, size_t len)
{
    (void)port;
    for (size_t i = 0; i < len; i++) {
        /* Of a line that is too long the end is kept: its end is seen. */
        if (scale.len == sizeof scale.line - 1)
            memmove(scale.line, scale.line + 1, --scale.len);
        scale.line[scale.len++] = (char)data[i];
        if (scale.len >= 2 && memcmp(scale.line + scale.len - 2, "\r\n", 2) == 0) {
            scale.line[scale.len - 2] = 0;
            scale.len = 0;
            hear(node, at, scale.line);
        }
    }
}

static uint64_t poll(hrn_node *node, uint64_t now)
{
    if (scale.zero_at <= now) {
        scale.zero_g += net_g(scale.zero_at);
        scale.zero_at = HRN_NEVER;
        hrn_send(node, 0, now, "ZI S\r\n", 6);
    }
    return scale.zero_at;
}

static size_t save(hrn_node *node, const uint8_t **data)
{
    (void)node;
    *data = (const uint8_t *)&scale;
    return sizeof scale;
}

static void load(hrn_node *node, const uint8_t *data, size_t len)
{
    (void)node;
    if (len == sizeof scale)
        memcpy(&scale, data, len);
}

int main(void)
{
    hrn_node node = {.start = start, .receive = receive, .fault = fault, .poll = poll,
        .save = save, .load = load, .faults = "\"draught\"", .outputs = "\"net_g\""};
    return hrn_main(&node);
}

/* The smallest node: sends back what it hears, 1 ms later. cc -O2 -I nodes nodes/examples/echo.c */
#define HILRIG_NODE_IMPLEMENTATION
#include "../hilrig_node.h"

static void receive(hrn_node *node, uint8_t port, uint64_t at, const uint8_t *data, size_t len)
{
    hrn_send(node, port, at + 1000000, data, len);
}

int main(void)
{
    hrn_node node = {.receive = receive};
    return hrn_main(&node);
}

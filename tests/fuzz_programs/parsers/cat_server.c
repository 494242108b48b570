/* A modem on cAT: two commands with numbers and a text. */
#include "stream.h"
#include "cat.h"

static int32_t x;
static uint8_t y;
static char message[16];

static struct cat_variable variables[] = {
    { .type = CAT_VAR_INT_DEC, .data = &x, .data_size = sizeof x, .name = "X" },
    { .type = CAT_VAR_UINT_DEC, .data = &y, .data_size = sizeof y, .name = "Y" },
    { .type = CAT_VAR_BUF_STRING, .data = message, .data_size = sizeof message, .name = "TEXT" },
};
static struct cat_command commands[] = {
    { .name = "+PRINT", .var = variables, .var_num = 3 },
    { .name = "+GO", .var = variables, .var_num = 2 },
};
static char buf[128];
static struct cat_command_group group = { .cmd = commands, .cmd_num = 2 };
static struct cat_command_group *groups[] = { &group };
static struct cat_descriptor descriptor = {
    .cmd_group = groups, .cmd_group_num = 1, .buf = buf, .buf_size = sizeof buf
};

static int put(char byte)
{
    return !isatty(stream) || write(stream, &byte, 1) == 1;
}

static int get(char *byte)
{
    *byte = (char)stream_next();
    return 1;
}

int main(int count, char **words)
{
    static struct cat_io_interface io = { .read = get, .write = put };
    struct cat_object at;
    (void)count;
    stream_open(words[1]);
    cat_init(&at, &descriptor, &io, NULL);
    for (;;)
        cat_service(&at);
}

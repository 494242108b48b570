/* Coverage of a program for "hilrig fuzz --exec": counters of its edges or blocks, and what it
 * compares, in a file that hilrig reads, which HILRIG_COVERAGE names. Without that variable it does
 * nothing.
 *
 * Build this file without coverage, and the program with it:
 *
 *   cc -c hilrig-coverage.c
 *   gcc     -fsanitize-coverage=trace-pc,trace-cmp -fno-builtin program.c hilrig-coverage.o
 *   g++     -fsanitize-coverage=trace-pc,trace-cmp -fno-builtin program.cpp hilrig-coverage.o
 *   clang   -fsanitize-coverage=trace-pc-guard,trace-cmp -fno-builtin program.c hilrig-coverage.o
 *   rustc   -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=3 \
 *           -Cllvm-args=-sanitizer-coverage-trace-pc-guard \
 *           -Cllvm-args=-sanitizer-coverage-trace-compares -Cllvm-args=-max-loads-per-memcmp=0 \
 *           -Clink-arg=hilrig-coverage.o program.rs
 *
 * -fno-builtin leaves the calls of strcmp and its like in the program; those of this file are weak:
 * a program's own go first.
 */
#include <fcntl.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SIZE 65536u /* counters */
#define PAIRS 1024u /* comparisons that are kept, */
#define PLACES 4096u /* so many times PER_PLACE at most of each place */
#define PER_PLACE 8
#define PER_PLACE_TEXTS 64 /* tables of words are looked through at one place */
#define SIDE 32u /* bytes of a side that are kept */
#define FLOATING 0x40u
#define TEXT 0x80u

struct pair {
    uint32_t place;
    uint8_t kind; /* bytes of a number, with FLOATING of a floating one; or TEXT */
    uint8_t len[2];
    uint8_t unused;
    uint8_t side[2][SIDE];
};

struct shared {
    uint8_t counters[SIZE];
    uint32_t count;
    uint32_t unused;
    struct pair pairs[PAIRS];
    uint8_t places[PLACES];
};

/* Where the linker puts the program: places are counted from there. */
extern const char __executable_start;

static uint8_t nobody_reads[SIZE];
static uint8_t *counters = nobody_reads;
static struct shared *shared; /* 0: comparisons are not recorded */

__attribute__((constructor(101))) static void hilrig_coverage_begin(void)
{
    const char *path = getenv("HILRIG_COVERAGE");
    int file = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    void *map;
    if (file < 0)
        return;
    map = mmap(0, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (map != MAP_FAILED) {
        shared = (struct shared *)map;
        counters = shared->counters;
    }
}

/* Counts up to 255 and stays there. */
static void count(uint32_t place)
{
    uint8_t *counter = &counters[place % SIZE];
    *counter += *counter < 255;
}

static uint32_t place_of(const void *at)
{
    return (uint32_t)((uintptr_t)at - (uintptr_t)&__executable_start) * 0x9E3779B1u >> 8;
}

/* gcc, clang: -fsanitize-coverage=trace-pc */
void __sanitizer_cov_trace_pc(void)
{
    count(place_of(__builtin_return_address(0)));
}

/* clang, rustc: trace-pc-guard. A guard is a number, 0 as long as it has none. */
void __sanitizer_cov_trace_pc_guard_init(uint32_t *start, uint32_t *stop)
{
    static uint32_t last;
    if (start == stop || *start)
        return;
    for (; start < stop; start++)
        *start = ++last;
}

void __sanitizer_cov_trace_pc_guard(uint32_t *guard)
{
    count(*guard);
}

/* A free pair for this place, or 0. */
static struct pair *pair_of(uint32_t place, uint32_t kind)
{
    struct shared *to = shared;
    struct pair *pair;
    uint32_t at;
    if (!to || to->places[place % PLACES] >= (kind == TEXT ? PER_PLACE_TEXTS : PER_PLACE))
        return 0;
    at = to->count;
    if (at >= PAIRS)
        return 0;
    to->count = at + 1;
    to->places[place % PLACES]++;
    pair = &to->pairs[at];
    pair->place = place;
    pair->kind = (uint8_t)kind;
    return pair;
}

static void put(struct pair *pair, int side, const void *bytes, size_t len)
{
    size_t at;
    pair->len[side] = (uint8_t)(len < SIDE ? len : SIDE);
    for (at = 0; at < pair->len[side]; at++)
        pair->side[side][at] = ((const uint8_t *)bytes)[at];
}

static void numbers(uint32_t place, uint32_t kind, uint64_t one, uint64_t other)
{
    struct pair *pair = one == other ? 0 : pair_of(place, kind);
    if (!pair)
        return;
    put(pair, 0, &one, sizeof one);
    put(pair, 1, &other, sizeof other);
}

#define NUMBERS(name, type, kind)                                                               \
    void __sanitizer_cov_trace_##name(type one, type other)                                     \
    {                                                                                           \
        numbers(place_of(__builtin_return_address(0)), kind, (uint64_t)one, (uint64_t)other);   \
    }
NUMBERS(cmp1, uint8_t, 1)
NUMBERS(cmp2, uint16_t, 2)
NUMBERS(cmp4, uint32_t, 4)
NUMBERS(cmp8, uint64_t, 8)
NUMBERS(const_cmp1, uint8_t, 1)
NUMBERS(const_cmp2, uint16_t, 2)
NUMBERS(const_cmp4, uint32_t, 4)
NUMBERS(const_cmp8, uint64_t, 8)

void __sanitizer_cov_trace_cmpd(double one, double other)
{
    union { double number; uint64_t bits; } a, b;
    a.number = one;
    b.number = other;
    numbers(place_of(__builtin_return_address(0)), FLOATING | 8, a.bits, b.bits);
}

void __sanitizer_cov_trace_cmpf(float one, float other)
{
    union { float number; uint32_t bits; } a, b;
    a.number = one;
    b.number = other;
    numbers(place_of(__builtin_return_address(0)), FLOATING | 4, a.bits, b.bits);
}

/* How many cases, how many bits, the cases. */
void __sanitizer_cov_trace_switch(uint64_t value, uint64_t *cases)
{
    uint32_t place = place_of(__builtin_return_address(0));
    uint64_t at;
    for (at = 0; shared && at < cases[0] && at < 64; at++)
        numbers(place + (uint32_t)at, (uint32_t)cases[1] / 8, value, cases[2 + at]);
}

static size_t length(const char *text, size_t most)
{
    size_t len = 0;
    while (len < most && text[len])
        len++;
    return len;
}

static void texts(const void *at, const void *one, size_t one_len, const void *other, size_t len)
{
    struct pair *pair = pair_of(place_of(at), TEXT);
    if (!pair)
        return;
    put(pair, 0, one, one_len);
    put(pair, 1, other, len);
}

static int lower(int byte)
{
    return byte >= 'A' && byte <= 'Z' ? byte + 32 : byte;
}

/* Of two texts up to most bytes, or of memory; how they compare as the C library says. */
static int compared(const void *at, const char *one, const char *other, size_t most, int is_text,
                    int is_folded)
{
    const uint8_t *a = (const uint8_t *)one, *b = (const uint8_t *)other;
    size_t place;
    for (place = 0; place < most; place++) {
        int x = is_folded ? lower(a[place]) : a[place];
        int y = is_folded ? lower(b[place]) : b[place];
        if (x != y) {
            if (shared && is_text)
                texts(at, one, length(one, most < SIDE ? most : SIDE), other,
                      length(other, most < SIDE ? most : SIDE));
            else if (shared)
                texts(at, one, most, other, most);
            return x - y;
        }
        if (is_text && !x)
            return 0;
    }
    return 0;
}

#define WEAK __attribute__((weak))
#define HERE __builtin_return_address(0)

WEAK int memcmp(const void *one, const void *other, size_t len)
{
    return compared(HERE, (const char *)one, (const char *)other, len, 0, 0);
}

WEAK int bcmp(const void *one, const void *other, size_t len)
{
    return compared(HERE, (const char *)one, (const char *)other, len, 0, 0);
}

WEAK int strcmp(const char *one, const char *other)
{
    return compared(HERE, one, other, (size_t)-1, 1, 0);
}

WEAK int strncmp(const char *one, const char *other, size_t most)
{
    return compared(HERE, one, other, most, 1, 0);
}

WEAK int strcasecmp(const char *one, const char *other)
{
    return compared(HERE, one, other, (size_t)-1, 1, 1);
}

WEAK int strncasecmp(const char *one, const char *other, size_t most)
{
    return compared(HERE, one, other, most, 1, 1);
}

#ifdef __cplusplus
}
#endif

/* Coverage of a program for "hilrig fuzz --exec": counters of its edges or blocks in a file that
 * hilrig reads, which HILRIG_COVERAGE names. Without that variable it does nothing.
 *
 * Build this file without coverage, and the program with it:
 *
 *   cc -c hilrig-coverage.c
 *   gcc     -fsanitize-coverage=trace-pc       program.c   hilrig-coverage.o -o program
 *   clang   -fsanitize-coverage=trace-pc-guard program.c   hilrig-coverage.o -o program
 *   clang++ -fsanitize-coverage=trace-pc-guard program.cpp hilrig-coverage.o -o program
 *   rustc   -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=3 \
 *           -Cllvm-args=-sanitizer-coverage-trace-pc-guard -Clink-arg=hilrig-coverage.o program.rs
 */
#include <fcntl.h>
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#ifdef __cplusplus
extern "C" {
#endif

#define SIZE 65536u

/* Where the linker puts the program: places are counted from there. */
extern const char __executable_start;

static uint8_t nobody_reads[SIZE];
static uint8_t *counters = nobody_reads;

__attribute__((constructor(101))) static void hilrig_coverage_begin(void)
{
    const char *path = getenv("HILRIG_COVERAGE");
    int file = path ? open(path, O_RDWR | O_CLOEXEC) : -1;
    void *map;
    if (file < 0)
        return;
    map = mmap(0, SIZE, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    close(file);
    if (map != MAP_FAILED)
        counters = (uint8_t *)map;
}

/* Counts up to 255 and stays there. */
static void count(uint32_t place)
{
    uint8_t *counter = &counters[place % SIZE];
    *counter += *counter < 255;
}

/* gcc, clang: -fsanitize-coverage=trace-pc */
void __sanitizer_cov_trace_pc(void)
{
    uintptr_t at = (uintptr_t)__builtin_return_address(0) - (uintptr_t)&__executable_start;
    count((uint32_t)(at * 0x9E3779B1u >> 8));
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

#ifdef __cplusplus
}
#endif

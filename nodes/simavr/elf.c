#include "elf.h"

#include <elf.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Load addresses of the linker: the program, then data, EEPROM, fuses and lock bits. */
static const uint32_t DATA = 0x800000, EEPROM = 0x810000, FUSES = 0x820000;
/* A firmware file with debug information is below 10 MB. */
static const long FILE_MAX = 64L << 20;

#define FAIL(...) return snprintf(error, error_size, __VA_ARGS__), -1

static int read_file(const char *path, uint8_t **bytes, size_t *len, char *error, size_t error_size) {
    FILE *file = fopen(path, "rb");
    if (!file)
        FAIL("%s: %s", path, strerror(errno));
    long end = -1;
    if (fseek(file, 0, SEEK_END) == 0)
        end = ftell(file);
    if (end < 0 || end > FILE_MAX || fseek(file, 0, SEEK_SET) != 0) {
        fclose(file);
        FAIL("%s: not a file of at most 64 MiB; expected an ELF file", path);
    }
    *len = (size_t)end;
    *bytes = malloc(*len + 1);
    size_t got = *bytes ? fread(*bytes, 1, *len, file) : 0;
    fclose(file);
    if (got != *len)
        FAIL("%s: cannot be read", path);
    return 0;
}

/* Whether `count` bytes from `offset` on lie within `size`. */
static int within(uint64_t offset, uint64_t count, uint64_t size) {
    return offset <= size && count <= size - offset;
}

/* The chip's name in the compiler's note ".note.gnu.avr.deviceinfo": a table of sizes and offsets,
 * then names; the first name is the chip's. */
static void find_name(const uint8_t *bytes, size_t len, const Elf32_Ehdr *head, char *name,
                      size_t name_size) {
    for (unsigned i = 0; i < head->e_shnum; i++) {
        Elf32_Shdr section;
        uint64_t at = head->e_shoff + (uint64_t)i * head->e_shentsize;
        if (head->e_shentsize < sizeof section || !within(at, sizeof section, len))
            return;
        memcpy(&section, bytes + at, sizeof section);
        if (section.sh_type != SHT_NOTE || !within(section.sh_offset, section.sh_size, len))
            continue;
        const char *note = (const char *)bytes + section.sh_offset;
        /* Head of 12 bytes, "AVR" and 0, then words: flash 2, RAM 2, EEPROM 2, size of the offsets. */
        if (section.sh_size < 48 || memcmp(note + 12, "AVR", 4) != 0)
            continue;
        for (size_t start = 16; start + 2 < section.sh_size; start++) {
            size_t most = section.sh_size - start;
            size_t letters = strnlen(note + start, most);
            if (letters < most && letters < name_size && strncmp(note + start, "at", 2) == 0) {
                memcpy(name, note + start, letters + 1);
                return;
            }
        }
    }
}

static int load(const char *path, const uint8_t *bytes, size_t len, struct memories *memories,
                char *error, size_t error_size) {
    Elf32_Ehdr head;
    if (len < sizeof head || memcmp(bytes, ELFMAG, SELFMAG) != 0)
        FAIL("%s: not an ELF file; give the .elf that the linker wrote, not a .hex or .bin", path);
    memcpy(&head, bytes, sizeof head);
    if (head.e_ident[EI_CLASS] != ELFCLASS32 || head.e_ident[EI_DATA] != ELFDATA2LSB ||
        head.e_machine != EM_AVR)
        FAIL("%s: a program for another processor (ELF machine %u); expected one for the AVR, "
             "from avr-gcc",
             path, head.e_machine);
    if (head.e_type != ET_EXEC)
        FAIL("%s: an object file or library; give the linked program", path);
    find_name(bytes, len, &head, memories->built_for, sizeof memories->built_for);
    for (unsigned i = 0; i < head.e_phnum; i++) {
        Elf32_Phdr part;
        uint64_t at = head.e_phoff + (uint64_t)i * head.e_phentsize;
        if (head.e_phentsize < sizeof part || !within(at, sizeof part, len))
            FAIL("%s: damaged: its table of segments lies outside of the file; link it again", path);
        memcpy(&part, bytes + at, sizeof part);
        if (part.p_type != PT_LOAD || part.p_filesz == 0)
            continue;
        if (!within(part.p_offset, part.p_filesz, len))
            FAIL("%s: damaged: segment %u lies outside of the file; link it again", path, i);
        const uint8_t *from = bytes + part.p_offset;
        if (part.p_paddr < DATA) {
            if (!within(part.p_paddr, part.p_filesz, memories->flash_size))
                FAIL("%s: its code ends at %lu, the chip has %zu bytes of flash; choose the board "
                     "that it was built for",
                     path, (unsigned long)part.p_paddr + part.p_filesz, memories->flash_size);
            memcpy(memories->flash + part.p_paddr, from, part.p_filesz);
            size_t end = part.p_paddr + part.p_filesz;
            if (end > memories->code_end)
                memories->code_end = end;
        } else if (part.p_paddr >= EEPROM && part.p_paddr < FUSES) {
            if (!within(part.p_paddr - EEPROM, part.p_filesz, memories->eeprom_size))
                FAIL("%s: its EEPROM data does not fit into %zu bytes; choose the board that it was "
                     "built for",
                     path, memories->eeprom_size);
            memcpy(memories->eeprom + (part.p_paddr - EEPROM), from, part.p_filesz);
        }
    }
    if (memories->code_end == 0)
        FAIL("%s: has no code for the flash; give the linked program", path);
    return 0;
}

int elf_load(const char *path, struct memories *memories, char *error, size_t error_size) {
    uint8_t *bytes = NULL;
    size_t len = 0;
    if (read_file(path, &bytes, &len, error, error_size) != 0)
        return -1;
    int loaded = load(path, bytes, len, memories, error, error_size);
    free(bytes);
    return loaded;
}

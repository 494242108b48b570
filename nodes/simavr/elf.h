/* Firmware files: ELF for the AVR. Reads any bytes: what cannot be loaded is an error that says why. */
#ifndef HILRIG_ELF_H
#define HILRIG_ELF_H

#include <stddef.h>
#include <stdint.h>

/* What a file puts into a microcontroller. Sizes are those of the chip. */
struct memories {
    uint8_t *flash;
    size_t flash_size;
    uint8_t *eeprom;
    size_t eeprom_size;
    /* End of what was written to the flash. */
    size_t code_end;
    /* Name of the chip that the compiler was asked for; empty if the file does not say. */
    char built_for[64];
};

/* Loads the file at `path`. 0, or -1 with a sentence in `error`. */
int elf_load(const char *path, struct memories *memories, char *error, size_t error_size);

#endif

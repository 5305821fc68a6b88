/* Lines of text for the core: reads words and numbers, writes fields and a CRC. */
#ifndef FAMRIG_TEXT_H
#define FAMRIG_TEXT_H

#include "famrig_core.h"

#ifdef __FLASH /* avr-gcc: constants remain in program memory */
#define FR_FLASH __flash
#else
#define FR_FLASH
#endif

#define FR_MAX_NUMBERS 2

enum fr_verb {
    FR_VERB_HELLO, FR_VERB_STATUS, FR_VERB_HB, FR_VERB_RP, FR_VERB_STRICT, FR_VERB_BOARD,
    FR_VERB_SET, FR_VERB_GAIN, FR_VERB_ILIM, FR_VERB_CAL, FR_VERB_RUN, FR_VERB_MAN, FR_VERB_STOP,
    FR_VERB_CLEAR, FR_VERB_SYNC, FR_VERB_TELE, FR_VERB_TRIP, FR_VERB_JUMP, FR_VERB_STALL,
    FR_VERB_HBMS, FR_VERB_FLOOR, FR_VERB_CEILING, FR_VERB_STILL, FR_VERB_FROZEN, FR_VERB_UNKNOWN
};

/* Reasons for refusing a command. */
enum fr_reason {
    FR_OK, FR_UNKNOWN, FR_NUMBER, FR_TRIPPED, FR_NO_LIMIT, FR_PRESSURE, FR_RUNNING, FR_BAUD,
    FR_OUTSIDE, FR_ABOVE_CEILING
};

typedef const FR_FLASH char *fr_text;

extern const FR_FLASH char fr_name[], fr_error[];

/* ---- out: a line begins with its letter and ends with its CRC ---- */
void fr_begin(famrig *d, char letter);
void fr_end(famrig *d);
void fr_field(famrig *d, uint32_t value);
void fr_signed_field(famrig *d, int32_t value);
void fr_text_field(famrig *d, fr_text text);
fr_text fr_reason(uint8_t reason);

/* ---- in ---- */
uint16_t fr_crc(const char *text);

/* Returns true if d->line is valid, and removes its CRC. */
bool fr_check(famrig *d, bool *checked);

/* Reads the id at the beginning of a line; 0 if there is none. */
uint16_t fr_id(const char **words);
uint8_t fr_verb(const char **words);

/* Returns the number of numbers read; -1 if one is missing, superfluous or out of range. */
int8_t fr_numbers(uint8_t verb, const char *words, int32_t *values);

/* Reads a repeat request into d->base and d->mask. */
bool fr_request(famrig *d, const char *words);

#endif

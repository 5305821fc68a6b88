#include "famrig_text.h"

typedef struct {
    int16_t unit; /* a number is stored as value * unit, rounded, within [low, high] */
    int32_t low, high;
} number_kind;

typedef struct {
    char name[8];
    int8_t least, most; /* numbers */
    number_kind numbers[FR_MAX_NUMBERS];
} command_kind;

static const FR_FLASH command_kind commands[FR_VERB_UNKNOWN] = {
    [FR_VERB_HELLO] = {"hello", 0, 0, {{0}}},
    [FR_VERB_STATUS] = {"status", 0, 0, {{0}}},
    [FR_VERB_HB] = {"hb", 0, 0, {{0}}},
    [FR_VERB_RP] = {"rp", 0, 0, {{0}}},
    [FR_VERB_STRICT] = {"strict", 1, 1, {{1, 0, 1}}},
    [FR_VERB_BOARD] = {"board", 1, 1, {{1, 1, 65534}}},
    [FR_VERB_SET] = {"set", 1, 2, {{128, 0, 131071}, {256, 0, 65280}}},
    [FR_VERB_GAIN] = {"gain", 2, 2, {{256, 0, 32767}, {256, 0, 32767}}},
    [FR_VERB_ILIM] = {"ilim", 2, 2, {{1, -255, 0}, {1, 0, 255}}},
    [FR_VERB_CAL] = {"cal", 2, 2, {{16, 0, 16383}, {64, 1, 65535}}},
    [FR_VERB_RUN] = {"run", 0, 0, {{0}}},
    [FR_VERB_MAN] = {"man", 1, 1, {{1, 0, 255}}},
    [FR_VERB_STOP] = {"stop", 0, 0, {{0}}},
    [FR_VERB_CLEAR] = {"clear", 0, 0, {{0}}},
    [FR_VERB_SYNC] = {"sync", 1, 1, {{1, 1, 1000}}},
    [FR_VERB_TELE] = {"tele", 1, 1, {{1, 1, 50}}},
    [FR_VERB_TRIP] = {"trip", 1, 1, {{1, 1, 1023}}},
    [FR_VERB_JUMP] = {"jump", 1, 1, {{1, 1, 1023}}},
    [FR_VERB_STALL] = {"stall", 1, 1, {{1, 500, 30000}}},
    [FR_VERB_HBMS] = {"hbms", 1, 1, {{1, 100, 10000}}},
    [FR_VERB_FLOOR] = {"floor", 1, 1, {{1, 0, 1022}}},
    [FR_VERB_CEILING] = {"ceiling", 1, 1, {{1, 1, 1023}}},
    [FR_VERB_STILL] = {"still", 1, 1, {{1, 500, 60000}}},
    [FR_VERB_FROZEN] = {"frozen", 2, 2, {{1, 1, 255}, {1, 100, 2000}}},
};

static const FR_FLASH char reasons[][31] = {
    [FR_OK] = "OK",
    [FR_UNKNOWN] = "unknown verb",
    [FR_NUMBER] = "number missing or out of range",
    [FR_TRIPPED] = "tripped: clear first",
    [FR_NO_LIMIT] = "no trip limit",
    [FR_PRESSURE] = "pressure above trip",
    [FR_RUNNING] = "running: stop first",
    [FR_BAUD] = "too fast for this baud",
    [FR_OUTSIDE] = "reading out of range",
    [FR_ABOVE_CEILING] = "above the compiled-in ceiling",
};

static const FR_FLASH uint32_t tens[] = {1,      10,      100,      1000,      10000,
                                         100000, 1000000, 10000000, 100000000, 1000000000};

const FR_FLASH char fr_name[] = "famrig", fr_error[] = "ERR";

fr_text fr_reason(uint8_t reason) { return reasons[reason]; }

/* Adds a byte to a CRC-16: polynomial 0x1021, initial value 0xFFFF, not reflected. */
static uint16_t crc_step(uint16_t crc, uint8_t byte)
{
    crc = (uint16_t)(crc << 8 | crc >> 8) ^ byte;
    crc ^= (crc & 0xFF) >> 4;
    crc ^= crc << 12;
    crc ^= (crc & 0xFF) << 5;
    return crc;
}

uint16_t fr_crc(const char *text)
{
    uint16_t crc = 0xFFFF;
    while (*text)
        crc = crc_step(crc, (uint8_t)*text++);
    return crc;
}

/* ---- out ---- */

static void put_raw(famrig *d, char byte)
{
    d->sending[d->sending_head] = (uint8_t)byte;
    d->sending_head = (d->sending_head + 1) & (FR_SEND_SIZE - 1);
}

static void put(famrig *d, char byte)
{
    d->check = crc_step(d->check, (uint8_t)byte);
    put_raw(d, byte);
}

static void put_text(famrig *d, fr_text text)
{
    while (*text)
        put(d, *text++);
}

void fr_begin(famrig *d, char letter)
{
    d->check = 0xFFFF;
    put(d, letter);
}

void fr_end(famrig *d)
{
    put_raw(d, '*');
    for (int8_t shift = 12; shift >= 0; shift -= 4) {
        uint8_t digit = d->check >> shift & 15;
        put_raw(d, (char)(digit < 10 ? '0' + digit : 'A' + digit - 10));
    }
    put_raw(d, '\n');
}

/* Subtracts powers of ten, because a division takes 600 cycles on an AVR. */
static void put_number(famrig *d, uint32_t value)
{
    uint8_t place = value < 1000 ? 2 : value < 100000 ? 4 : 9;
    while (place > 0 && value < tens[place])
        place--;
    for (;;) {
        uint32_t power = tens[place];
        char digit = '0';
        for (; value >= power; value -= power)
            digit++;
        put(d, digit);
        if (place-- == 0)
            return;
    }
}

static void put_signed(famrig *d, int32_t value)
{
    if (value < 0)
        put(d, '-');
    put_number(d, value < 0 ? -(uint32_t)value : (uint32_t)value);
}

void fr_field(famrig *d, uint32_t value)
{
    put(d, ',');
    put_number(d, value);
}

void fr_signed_field(famrig *d, int32_t value)
{
    put(d, ',');
    put_signed(d, value);
}

void fr_text_field(famrig *d, fr_text text)
{
    put(d, ',');
    put_text(d, text);
}

/* ---- in ---- */

static bool is_digit(char c) { return c >= '0' && c <= '9'; }

static bool ends(char c) { return c == '\0' || c == ' '; }

static const char *skip_spaces(const char *text)
{
    while (*text == ' ')
        text++;
    return text;
}

/* Value of an upper-case hexadecimal digit, or -1. */
static int8_t hex_digit(char c)
{
    if (is_digit(c))
        return c - '0';
    return c >= 'A' && c <= 'F' ? c - 'A' + 10 : -1;
}

bool fr_check(famrig *d, bool *checked)
{
    uint8_t length = d->line_length;
    d->line[length] = '\0';
    *checked = length > 4 && d->line[length - 5] == '*';
    if (!*checked) {
        for (const char *c = d->line; *c; c++)
            if (*c == '*')
                return false;
        return !d->strict;
    }
    uint16_t crc = 0;
    for (uint8_t at = length - 4; at < length; at++) {
        int8_t digit = hex_digit(d->line[at]);
        if (digit < 0)
            return false;
        crc = crc << 4 | (uint16_t)digit;
    }
    d->line[length - 5] = '\0';
    return crc == fr_crc(d->line);
}

uint16_t fr_id(const char **words)
{
    const char *text = *words = skip_spaces(*words);
    uint32_t id = 0;
    uint8_t digits = 0;
    for (; is_digit(*text) && digits < 6; digits++)
        id = 10 * id + (uint8_t)(*text++ - '0');
    if (digits < 1 || digits > 5 || !ends(*text) || id > 0xFFFF)
        return 0;
    *words = text;
    return (uint16_t)id;
}

uint8_t fr_verb(const char **words)
{
    const char *text = skip_spaces(*words);
    for (uint8_t verb = 0; verb < FR_VERB_UNKNOWN; verb++) {
        uint8_t at = 0;
        while (commands[verb].name[at] && text[at] == commands[verb].name[at])
            at++;
        if (!commands[verb].name[at] && ends(text[at])) {
            *words = text + at;
            return verb;
        }
    }
    return FR_VERB_UNKNOWN;
}

/* A decimal number of at most six digits and four decimals, up to the end of the word. */
static bool read_number(const char **words, const FR_FLASH number_kind *kind, int32_t *value)
{
    const char *text = *words;
    bool negative = *text == '-';
    int32_t whole = 0, fraction = 0, power = 1;
    uint8_t digits = 0;
    text += negative;
    for (; is_digit(*text) && digits <= 6; digits++)
        whole = 10 * whole + (*text++ - '0');
    if (digits < 1 || digits > 6)
        return false;
    if (*text == '.' && kind->unit != 1)
        for (text++; is_digit(*text) && power < 10000; power *= 10)
            fraction = 10 * fraction + (*text++ - '0');
    if (!ends(*text))
        return false;
    *value = whole * kind->unit + (2 * fraction * kind->unit + power) / (2 * power);
    if (negative)
        *value = -*value;
    *words = text;
    return kind->low <= *value && *value <= kind->high;
}

int8_t fr_numbers(uint8_t verb, const char *words, int32_t *values)
{
    int8_t number = 0;
    for (words = skip_spaces(words); *words; words = skip_spaces(words)) {
        if (number == commands[verb].most)
            return -1;
        if (!read_number(&words, &commands[verb].numbers[number], &values[number]))
            return -1;
        number++;
    }
    return number < commands[verb].least ? -1 : number;
}

bool fr_request(famrig *d, const char *words)
{
    uint32_t base = 0, low = 0, high = 0;
    uint8_t digits = 0;
    for (words = skip_spaces(words); is_digit(*words); words++, digits++) {
        uint8_t digit = (uint8_t)(*words - '0');
        if (digits == 10 || base > (0xFFFFFFFFu - digit) / 10)
            return false;
        base = 10 * base + digit;
    }
    if (digits == 0 || *words != ' ')
        return false;
    digits = 0;
    for (words = skip_spaces(words); !ends(*words); words++, digits++) {
        char c = *words >= 'a' && *words <= 'f' ? (char)(*words - 'a' + 'A') : *words;
        if (digits == 16 || hex_digit(c) < 0)
            return false;
        high = high << 4 | low >> 28;
        low = low << 4 | (uint32_t)hex_digit(c);
    }
    if (digits == 0 || *skip_spaces(words) != '\0')
        return false;
    d->base = base;
    d->mask_low = low;
    d->mask_high = high;
    return true;
}

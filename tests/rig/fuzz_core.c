/* The core under a host that sends anything, and any readings: nothing undefined, nothing unsafe.
 *
 *     cc -std=c99 -g -O1 -fsanitize=address,undefined -fno-sanitize-recover=all -I rig/firmware \
 *         tests/rig/fuzz_core.c rig/firmware/famrig_core.c \
 *         rig/firmware/famrig_plausibility.c rig/firmware/famrig_text.c -o fuzz
 *     ./fuzz SEED TICKS        random lines, right, nearly right and not at all
 *     ./fuzz < FILE            what a fuzzer that changes files gives (AFL) */
#include "famrig_core.h"
#include "famrig_text.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static famrig device;
static uint8_t kept_fault;
static uint32_t heard; /* lines accepted before the last reset */

static void demand(bool holds, const char *what)
{
    if (holds)
        return;
    fprintf(stderr, "not so: %s\n", what);
    abort();
}

/* A tick, and what must hold after it whatever came in. */
static void tick(uint16_t pressure, uint16_t force, bool cleared)
{
    size_t number = 0;
    bool driven = !famrig_dump_open(&device);
    famrig_mark(&device);
    famrig_step(&device, pressure, force);
    famrig_serve(&device);
    famrig_release(&device);
    for (int16_t byte = famrig_next(&device); byte >= 0; byte = famrig_next(&device)) {
        demand(byte == '\n' || (byte >= ' ' && byte <= '~'), "what is sent is text");
        number++;
    }
    demand(number <= FR_BYTES_PER_TICK, "a tick sends no more than the line carries");
    demand(device.state <= FR_TRIP, "the state is one of four");
    demand(device.output == 0 || !famrig_dump_open(&device), "an output only where the dump is shut");
    demand(device.trip <= FR_TRIP_CEILING, "no limit above the ceiling");
    demand(driven || famrig_dump_open(&device) || device.trip > 0, "nothing starts without a limit");
    demand((device.state == FR_TRIP) == (device.latch.fault != 0), "a trip is latched, all else not");
    demand(kept_fault == 0 || device.latch.fault == kept_fault || cleared, "only `clear` ends a trip");
    kept_fault = device.latch.fault;
}

static void start(uint8_t cause)
{
    fr_latch latch = device.latch;
    heard += device.good;
    famrig_reset(&device, cause, device.boot, latch);
}

/* Bytes as they come: one per tick from the host, one that says where the reading goes. */
static void run(const uint8_t *data, size_t size)
{
    static const uint16_t levels[] = {0, 50, 51, 100, 102, 103, 200, 563, 600, 899, 900, 963, 964, 1023};
    uint16_t pressure = 102;
    memset(&device, 0, sizeof device);
    kept_fault = 0;
    start(FR_POWER_ON);
    for (size_t at = 0; at + 1 < size; at += 2) {
        uint8_t what = data[at + 1];
        famrig_receive(&device, data[at]);
        if (what >= 0xF0)
            pressure = levels[what % (sizeof levels / sizeof *levels)];
        else if (what >= 0xEC)
            start((uint8_t)(1u << (what & 3)));
        else if (what < 0x20)
            pressure = (pressure + what - 0x0F) & 1023;
        tick(pressure, (uint16_t)(what * 4), true);
    }
}

static uint32_t state;

static uint32_t any(uint32_t below)
{
    state ^= state << 13;
    state ^= state >> 17;
    state ^= state << 5;
    return state % below;
}

static const char *const verbs[] = {
    "hello", "status", "hb", "rp", "strict", "board", "set", "gain", "ilim", "cal", "run", "run", "run",
    "man", "stop", "sync", "tele", "trip", "jump", "stall", "hbms", "floor", "ceiling", "still", "frozen",
    "nonsense"};
static const char *const numbers[] = {
    "0", "1", "4", "5", "50", "99", "128", "255", "256", "600", "900", "901", "1023", "1024", "2000",
    "30000", "60000", "65535", "-1", "-255", "0.0039", "127.996", "102.4", "999999", "1e3", "ffffffff"};

/* A line of the host; whether it is `clear`. */
static bool line(char *text, size_t size)
{
    bool clear = any(60) == 0;
    int length = snprintf(text, size - 8, "%u %s", any(3), clear ? "clear" : verbs[any(26)]);
    for (uint32_t words = clear ? 0 : any(4); words > 0; words--)
        length += snprintf(text + length, size - 8 - (size_t)length, " %s", numbers[any(26)]);
    if (any(3))
        length += snprintf(text + length, 8, "*%04X", fr_crc(text));
    if (any(20) == 0)
        text[any((uint32_t)length)] = (char)any(256);
    text[length++] = '\n';
    text[length] = '\0';
    return clear;
}

static void run_at_random(uint32_t seed, uint32_t ticks)
{
    char text[256];
    uint16_t pressure = 102;
    uint32_t cleared = 0;
    state = seed * 2654435761u + 1;
    memset(&device, 0, sizeof device);
    start(FR_POWER_ON);
    while (ticks-- > 0) {
        if (any(20) == 0) {
            if (line(text, sizeof text))
                cleared = 40; /* ticks until the device has read what came before */
            for (const char *c = text; *c; c++)
                famrig_receive(&device, (uint8_t)*c);
        }
        if (any(300) == 0)
            pressure = (uint16_t)any(1024);
        else if (any(2))
            pressure = (uint16_t)(pressure + any(3) - 1) & 1023;
        if (any(50000) == 0)
            start((uint8_t)(1u << any(4)));
        tick(pressure, (uint16_t)any(1024), cleared > 0);
        cleared -= cleared > 0;
    }
}

int main(int count, char **words)
{
    if (count == 3) {
        run_at_random((uint32_t)strtoul(words[1], NULL, 10), (uint32_t)strtoul(words[2], NULL, 10));
        printf("boots %u, heard %lu\n", device.boot, (unsigned long)(heard + device.good));
    } else {
        static uint8_t data[1 << 16];
        run(data, fread(data, 1, sizeof data, stdin));
    }
    return 0;
}

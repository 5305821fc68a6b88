/* SPDX-License-Identifier: GPL-3.0-or-later
 *
 * An ATmega328P under simavr in lock step with a plant: one call per tick of the firmware.
 * It links simavr, which is GPL-3, and stays in the tests for that. */
#include <simavr/avr_adc.h>
#include <simavr/avr_eeprom.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_cycle_timers.h>
#include <simavr/sim_hex.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

enum { MCUSR = 0x54, TCCR0A = 0x44, OCR0A = 0x47, UCSR0B = 0xC1, PORTD = 0x2B, SPL = 0x5D };
enum { RXEN = 1 << 4, COM0A1 = 1 << 7 };
enum { OUT_SIZE = 1 << 20, IN_SIZE = 4096 };

typedef struct {
    avr_t *avr;
    avr_irq_t *adc, *uart;
    uint32_t counts[2], latched; /* pressure and force; the force of the tick under way */
    int ticked; /* the firmware has started a conversion of channel 0 that counts */
    unsigned source; /* of the last conversion */
    uint8_t out[OUT_SIZE], in[IN_SIZE];
    size_t out_length, in_head, in_tail;
    avr_cycle_count_t byte_cycles, changed, lowest_stack;
    int output;
} harness;

static void silent(avr_t *avr, const int level, const char *format, va_list values)
{
    (void)avr, (void)level, (void)format, (void)values;
}

static void no_sleep(avr_t *avr, avr_cycle_count_t cycles) { (void)avr, (void)cycles; }

static void on_byte(avr_irq_t *irq, uint32_t value, void *param)
{
    harness *h = param;
    (void)irq;
    if (h->out_length < OUT_SIZE)
        h->out[h->out_length++] = (uint8_t)value;
}

/* simavr takes millivolts: the least that convert to these counts. */
static void present(harness *h, int channel, uint32_t counts)
{
    avr_raise_irq(h->adc + ADC_IRQ_ADC0 + channel, (counts * 5000 + 1022) / 1023);
}

/* A conversion starts. That of the force follows within the tick, when the next may be known. The
 * first one after a change of the channel is not used: it is given the other channel's counts. */
static void on_conversion(avr_irq_t *irq, uint32_t value, void *param)
{
    harness *h = param;
    union { uint32_t value; avr_adc_mux_t mux; } conversion = {.value = value};
    unsigned source = conversion.mux.src;
    (void)irq;
    if (source != h->source) {
        h->source = source;
        present(h, (int)source, source == 0 ? h->latched : h->counts[0]);
        return;
    }
    present(h, (int)source, source == 0 ? h->counts[0] : h->latched);
    if (source == 0) {
        h->latched = h->counts[1];
        h->ticked = 1;
    }
}

/* One byte on the line, and the next after 11 bits: simavr's receiver takes them no faster. */
static avr_cycle_count_t next_byte(avr_t *avr, avr_cycle_count_t when, void *param)
{
    harness *h = param;
    (void)avr;
    if (h->in_tail == h->in_head)
        return 0;
    avr_raise_irq(h->uart + UART_IRQ_INPUT, h->in[h->in_tail++ % IN_SIZE]);
    return when + h->byte_cycles;
}

/* Does nothing, but a sleep ends at a timer. */
static avr_cycle_count_t stop_here(avr_t *avr, avr_cycle_count_t when, void *param)
{
    (void)avr, (void)when, (void)param;
    return 0;
}

harness *harness_open(const char *hex, uint32_t bit_cycles)
{
    uint32_t size = 0, base = 0;
    uint8_t *flash = read_ihex_file(hex, &size, &base);
    avr_t *avr = avr_make_mcu_by_name("atmega328p");
    if (!flash || !avr)
        return NULL;
    harness *h = calloc(1, sizeof *h);
    avr_global_logger_set(silent);
    avr_init(avr);
    avr->log = 0;
    avr->frequency = 16000000;
    avr->vcc = avr->avcc = avr->aref = 5000;
    avr->sleep = no_sleep;
    avr_loadcode(avr, flash, size, base);
    avr->codeend = base + size;
    free(flash);
    h->avr = avr;
    h->byte_cycles = 11 * bit_cycles;
    h->adc = avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, 0);
    h->uart = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), 0);
    uint32_t flags = 0;
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
    avr_irq_register_notify(h->uart + UART_IRQ_OUTPUT, on_byte, h);
    avr_irq_register_notify(h->adc + ADC_IRQ_OUT_TRIGGER, on_conversion, h);
    h->lowest_stack = 0xFFFF;
    return h;
}

void harness_close(harness *h)
{
    avr_terminate(h->avr);
    free(h->avr);
    free(h);
}

/* What the pin of the PWM carries [counts]. */
static int output_now(harness *h)
{
    uint8_t *data = h->avr->data;
    return data[TCCR0A] & COM0A1 ? data[OCR0A] : data[PORTD] & 1 << 6 ? 255 : 0;
}

static int one_step(harness *h)
{
    int state = avr_run(h->avr);
    uint16_t stack = h->avr->data[SPL] | h->avr->data[SPL + 1] << 8;
    if (stack && stack < h->lowest_stack)
        h->lowest_stack = stack;
    int output = output_now(h);
    if (output != h->output) {
        h->output = output;
        h->changed = h->avr->cycle;
    }
    return state != cpu_Done && state != cpu_Crashed;
}

/* Reset with a cause (MCUSR), and run until the firmware listens. */
int harness_reset(harness *h, uint8_t cause)
{
    h->in_tail = h->in_head;
    h->source = 0;
    avr_reset(h->avr);
    h->avr->data[MCUSR] = cause;
    h->avr->data[UCSR0B] = 0;
    while (!(h->avr->data[UCSR0B] & RXEN))
        if (!one_step(h))
            return -1;
    return 0;
}

static void feed(harness *h, const uint8_t *bytes, size_t number)
{
    while (number-- > 0)
        h->in[h->in_head++ % IN_SIZE] = *bytes++;
    if (h->in_tail != h->in_head && !avr_cycle_timer_status(h->avr, next_byte, h))
        avr_cycle_timer_register(h->avr, 1, next_byte, h);
}

/* Bytes arrive, then a tick begins and converts these counts; its work is done in the next call. */
int harness_tick(harness *h, uint32_t pressure, uint32_t force, const uint8_t *bytes, size_t number)
{
    feed(h, bytes, number);
    h->counts[0] = pressure;
    h->counts[1] = force;
    h->ticked = 0;
    while (!h->ticked) {
        int state = avr_run(h->avr);
        if (state == cpu_Done || state == cpu_Crashed)
            return -1;
    }
    return output_now(h);
}

/* Free running for some cycles, to look at times finer than a tick. */
int harness_run(harness *h, uint32_t pressure, uint32_t cycles, const uint8_t *bytes, size_t number)
{
    avr_cycle_count_t end = h->avr->cycle + cycles;
    feed(h, bytes, number);
    h->counts[0] = pressure;
    avr_cycle_timer_register(h->avr, cycles, stop_here, h);
    while (h->avr->cycle < end) /* a reset forgets all timers */
        if (!one_step(h))
            return -1;
    return h->output;
}

/* The program runs in circles from here on, its interrupts still served. */
int harness_hang(harness *h)
{
    for (avr_flashaddr_t at = 0; at + 1 < h->avr->codeend; at += 2)
        if (h->avr->flash[at] == 0xFF && h->avr->flash[at + 1] == 0xCF) { /* rjmp to itself */
            h->avr->pc = at;
            h->avr->state = cpu_Running;
            return 0;
        }
    return -1;
}

size_t harness_take(harness *h, uint8_t *bytes, size_t size)
{
    size_t number = h->out_length < size ? h->out_length : size;
    memcpy(bytes, h->out, number);
    memmove(h->out, h->out + number, h->out_length - number);
    h->out_length -= number;
    return number;
}

uint64_t harness_cycle(harness *h) { return h->avr->cycle; }
uint64_t harness_changed(harness *h) { return h->changed; }
uint32_t harness_stack(harness *h) { return (uint32_t)h->lowest_stack; }
int harness_pin(harness *h, int pin) { return h->avr->data[PORTD] >> pin & 1; }

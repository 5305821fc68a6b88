/* Registers of the ATmega328P at 16 MHz (Arduino Uno, Nano). The wiring is in README.md.
 *
 * Timer 1 generates the tick and starts the conversions. Timer 0 generates the PWM. The watchdog resets a
 * program that has not finished a tick for 250 ms. This program does not use the Arduino core. */
#ifndef __AVR_ATmega328P__
#error "this port is for the ATmega328P; the core takes another one: see famrig_core.h"
#endif

#include "famrig_core.h"

#include <avr/eeprom.h>
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>

#ifndef F_CPU
#define F_CPU 16000000UL
#endif
#ifndef FR_BAUD_RATE
#define FR_BAUD_RATE 115200UL
#endif
#define DIVISOR ((F_CPU / 4 / FR_BAUD_RATE + 1) / 2 - 1) /* double speed, rounded */
#if FR_BYTES_PER_TICK * 10UL * FR_TICK_HZ > F_CPU / 8 / (DIVISOR + 1)
#error "FR_BYTES_PER_TICK is more than FR_BAUD_RATE carries"
#endif

#ifdef FR_AREF_EXTERNAL
#define REFERENCE 0 /* the voltage at the pin AREF */
#else
#define REFERENCE _BV(REFS0) /* AVCC, 4.75 to 5.25 V with USB power, see README.md */
#endif

#define PRESSURE_INPUT 0 /* A0 */
#define FORCE_INPUT 1    /* A1 */
#define DUMP_CLOSED PD4  /* high: the normally open dump valve is closed */
#define PWM PD6          /* OC0A */
#define SYNC PD7
#define LIGHT PB5 /* on while the muscle may be under pressure */
#define FAST_PWM (_BV(WGM01) | _BV(WGM00)) /* (u + 1) / 256, pin not connected */

static famrig device;
static volatile uint8_t ticks;
static volatile uint16_t pressure, force;
static volatile bool converted, settled;
static uint8_t reset_cause __attribute__((section(".noinit")));
static uint16_t boot_counter EEMEM = 0xFFFF;
static fr_latch latch EEMEM = {0xFF, 0xFF, 0xFFFF, 0xFFFF};

/* After a watchdog reset, the watchdog keeps running at 16 ms and must be stopped first. */
void save_cause(void) __attribute__((naked, used, section(".init3")));
void save_cause(void)
{
    reset_cause = MCUSR & 15;
    MCUSR = 0;
    wdt_disable();
}

static void start_conversion(uint8_t input)
{
    settled = (ADMUX & 15) == input;
    ADMUX = REFERENCE | input;
    ADCSRA |= _BV(ADSC);
}

ISR(TIMER1_COMPA_vect)
{
    start_conversion(PRESSURE_INPUT);
    famrig_mark(&device);
    ticks++;
}

/* The first conversion after a change of the input is not used, because the sampling capacitor still holds
 * the voltage of the other input, and through 1 Mohm it takes more than one conversion to settle. The first
 * conversion of the pressure follows that of the force, so that the next tick begins with a valid one. */
ISR(ADC_vect)
{
    bool good = settled;
    uint8_t input = ADMUX & 15;
    if (!good && input == PRESSURE_INPUT)
        return;
    if (!good) {
        start_conversion(input);
    } else if (input == PRESSURE_INPUT) {
        pressure = ADC;
        start_conversion(FORCE_INPUT);
    } else {
        force = ADC;
        converted = true;
        start_conversion(PRESSURE_INPUT);
    }
}

ISR(USART_RX_vect) { famrig_receive(&device, UDR0); }

ISR(USART_UDRE_vect)
{
    int16_t byte = famrig_next(&device);
    if (byte < 0)
        UCSR0B &= (uint8_t)~_BV(UDRIE0);
    else
        UDR0 = (uint8_t)byte;
}

static void start(void)
{
    PORTD = _BV(PD0); /* pull-up, so that an open line is quiet */
    DDRD = _BV(DUMP_CLOSED) | _BV(PWM) | _BV(SYNC);
    DDRB = _BV(LIGHT);
    fr_latch kept;
    eeprom_read_block(&kept, &latch, sizeof kept);
    famrig_reset(&device, reset_cause, eeprom_read_word(&boot_counter), kept);
    eeprom_update_word(&boot_counter, device.boot);
    DIDR0 = _BV(ADC0D) | _BV(ADC1D);
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADPS2) | _BV(ADPS1) | _BV(ADPS0); /* 125 kHz */
    TCCR0A = FAST_PWM;
    TCCR0B = _BV(CS01); /* 7.8 kHz */
    OCR1A = F_CPU / 8 / FR_TICK_HZ - 1;
    TCCR1A = 0;
    TCCR1B = _BV(WGM12) | _BV(CS11);
    TIMSK1 = _BV(OCIE1A);
    UCSR0A = _BV(U2X0); /* simavr requires this before the divisor */
    UBRR0 = DIVISOR;
    UCSR0B = _BV(RXCIE0) | _BV(RXEN0) | _BV(TXEN0);
    UCSR0C = _BV(UCSZ01) | _BV(UCSZ00);
    wdt_enable(WDTO_250MS);
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
}

/* Writes at most one changed byte of the latch per tick; the hardware takes 3.4 ms for it. */
static void keep_latch(void)
{
    const uint8_t *bytes = (const uint8_t *)&device.latch;
    for (uint8_t at = 0; at < sizeof latch; at++)
        if (eeprom_is_ready() && eeprom_read_byte((uint8_t *)&latch + at) != bytes[at])
            eeprom_write_byte((uint8_t *)&latch + at, bytes[at]);
}

static void set_pin(volatile uint8_t *port, uint8_t pin, bool high)
{
    *port = high ? *port | _BV(pin) : *port & (uint8_t)~_BV(pin);
}

/* At 0 the pin is disconnected from the timer and goes low immediately, without the spike of fast PWM. */
static void set_outputs(void)
{
    bool pressurised = !famrig_dump_open(&device);
    OCR0A = device.output;
    TCCR0A = device.output ? FAST_PWM | _BV(COM0A1) : FAST_PWM;
    set_pin(&PORTD, DUMP_CLOSED, pressurised);
    set_pin(&PORTD, SYNC, device.sync);
    set_pin(&PORTB, LIGHT, pressurised);
}

static void wait_for_conversions(void)
{
    cli();
    while (!converted) {
        sleep_enable();
        sei();
        sleep_cpu(); /* the instruction after sei always runs, so no wake-up is lost */
        sleep_disable();
        cli();
    }
    converted = false;
}

int main(void)
{
    start();
    for (;;) {
        wait_for_conversions();
        uint8_t passed = ticks;
        uint16_t p = pressure, f = force;
        ticks = 0;
        sei();
        if (passed > 1)
            famrig_late(&device, passed - 1);
        famrig_step(&device, p, f);
        set_outputs();
        famrig_serve(&device);
        set_outputs(); /* a stop command may have arrived */
        keep_latch();
        cli();
        famrig_release(&device);
        sei();
        UCSR0B |= _BV(UDRIE0);
        wdt_reset();
    }
}

/* An ATmega328P that sends the bits of forces, of the pressures for them, and how long each took. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <stdio.h>
#include <string.h>

#include "dmsp_20.h"

static int put(char letter, FILE *to)
{
    (void)to;
    loop_until_bit_is_set(UCSR0A, UDRE0);
    UDR0 = (unsigned char)letter;
    return 0;
}

static FILE out = FDEV_SETUP_STREAM(put, 0, _FDEV_SETUP_WRITE);

static unsigned long bits(float value)
{
    unsigned long whole;
    memcpy(&whole, &value, sizeof whole);
    return whole;
}

int main(void)
{
    static const float lengths[] = {0.24f, 0.28f, 0.31f, 0.35f};
    UCSR0B = _BV(TXEN0);
    stdout = &out;
    TCCR1B = _BV(CS12) | _BV(CS10); /* one count is 1024 cycles */
    for (unsigned char k = 0; k < 4; k++) {
        volatile float length = lengths[k];
        const unsigned start = TCNT1;
        const float force = dmsp_20_force(length, 4e5f);
        const unsigned middle = TCNT1;
        const float pressure = dmsp_20_pressure(length, force);
        const unsigned end = TCNT1;
        printf("%08lx %08lx %u %u\n", bits(force), bits(pressure), middle - start, end - middle);
    }
    cli();
    sleep_mode();
    return 0;
}

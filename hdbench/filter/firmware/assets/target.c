/* Start of the self-test on a Cortex-M4F without library or board support, with semihosting:
 *   qemu-system-arm -M mps2-an386 -nographic -semihosting -icount shift=0 \
 *       -kernel selftest-m4.elf */
#include <stddef.h>
#include <stdint.h>

int target_main(void);
void target_write(const char *text);
unsigned long target_ticks(void);
void target_reset(void);
void *memcpy(void *to, const void *from, size_t n);
void *memset(void *to, int value, size_t n);

extern unsigned long target_stack_top;

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[2] = {
    (uintptr_t)&target_stack_top, (uintptr_t)target_reset};

static long call_host(long operation, const void *argument)
{
    register long r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xab" : "+r"(r0) : "r"(r1) : "memory");
    return r0;
}

void target_write(const char *text) { (void)call_host(4, text); }

/* SysTick counts down at 25 MHz; with -icount shift=0 an instruction takes 1 ns: 40 to a tick. */
static volatile uint32_t *const systick = (volatile uint32_t *)0xe000e010u;

unsigned long target_ticks(void)
{
    static uint32_t last = 0xffffff;
    static unsigned long total = 0;
    const uint32_t now = systick[2] & 0xffffff;
    total += ((last - now) & 0xffffff) * 40UL;
    last = now;
    return total;
}

void target_reset(void)
{
    *(volatile uint32_t *)0xe000ed88u |= 0xf00000u; /* floating-point unit on */
    __asm__ volatile("dsb\n isb");
    systick[1] = 0xffffff;
    systick[2] = 0;
    systick[0] = 5; /* on, processor clock, no interrupt */
    const uint32_t code = target_main() == 0 ? 0x20026u : 0x20023u; /* application exit, or error */
    (void)call_host(0x18, (const void *)(uintptr_t)code);
    for (;;) {
    }
}

void *memcpy(void *to, const void *from, size_t n)
{
    unsigned char *a = to;
    const unsigned char *b = from;
    while (n-- > 0)
        *a++ = *b++;
    return to;
}

void *memset(void *to, int value, size_t n)
{
    unsigned char *a = to;
    while (n-- > 0)
        *a++ = (unsigned char)value;
    return to;
}

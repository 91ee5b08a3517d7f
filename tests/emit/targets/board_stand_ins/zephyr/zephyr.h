/* Stand-in for the headers of Zephyr that the sample includes: its functions with their types. */
#ifndef ZEPHYR_H
#define ZEPHYR_H
#include <stddef.h>
#include <stdint.h>
struct k_timer { int running; };
struct device { int ready; };
struct wdt_timeout_cfg { struct { uint32_t min, max; } window; void *callback; uint8_t flags; };
#define K_TIMER_DEFINE(name, expired, stopped) static struct k_timer name
#define K_USEC(microseconds) (microseconds)
#define DT_ALIAS(name) name
extern const struct device watchdog0;
#define DEVICE_DT_GET_OR_NULL(node) (&(node))
#define WDT_FLAG_RESET_SOC 2
void k_timer_start(struct k_timer *timer, int duration, int period);
uint32_t k_timer_status_sync(struct k_timer *timer);
uint32_t k_cycle_get_32(void);
uint64_t k_cyc_to_ns_floor64(uint64_t cycles);
int wdt_install_timeout(const struct device *dev, const struct wdt_timeout_cfg *cfg);
int wdt_setup(const struct device *dev, uint8_t options);
int wdt_feed(const struct device *dev, int channel_id);
void printk(const char *fmt, ...);
#endif

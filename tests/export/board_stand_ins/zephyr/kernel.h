#include <zephyr/zephyr.h>

/* The texts of statuses and reasons. */
#include "kernel.h"
const char *ik_status_string(ik_status status)
{
    static const char *const texts[] = {
        STATUS_TEXTS, "unknown status"};
    const unsigned number = (unsigned)status; /* the compiler may choose any integer type for an enumeration */
    return texts[(number <= LAST_STATUS) ? number : UNKNOWN_STATUS];
}

const char *ik_reason(int stage)
{
    static const char *const texts[] = {
        REASONS
    };
    return texts[((stage >= 0) && (stage < REASON_COUNT)) ? stage : 0];
}

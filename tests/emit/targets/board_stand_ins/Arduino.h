/* Stand-in for what the sketches use of Arduino. */
#ifndef ARDUINO_H
#define ARDUINO_H
static struct {
    void begin(long) {}
    template <class T> void print(T) {}
    template <class T> void println(T) {}
} Serial;
static inline unsigned long micros() { return 0; }
static inline void delay(unsigned long) {}
#endif

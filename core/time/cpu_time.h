// CPU time and memory of this process. Linux.
#pragma once

namespace etalon {

double thread_cpu_ms();   // of the calling thread
double process_cpu_ms();  // of all threads

// Largest resident memory so far, MiB (VmHWM).
double peak_memory_mib();

}  // namespace etalon

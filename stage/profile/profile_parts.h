// How a profile is read, in parts: internal to stage/profile/. Each part checks what it reads
// as soon as it can, so that an error stands at the value that is wrong.
#pragma once

#include "stage/profile/profile.h"
#include "stage/profile/profile_layers.h"

namespace etalon {

// poll, position, alarm_code, signals, inputs, target and watchdog; needs max_axes.
void read_profile_registers(const Layers& root, StageProfile& profile);

// sequences; needs the registers.
void read_profile_sequences(const Layers& root, StageProfile& profile);

// The words of the vocabulary in their order.
struct SignalWord {
    Signal signal;
    const char* word;
};
struct InputWord {
    Input input;
    const char* word;
};
const std::vector<SignalWord>& signal_words();
const std::vector<InputWord>& input_words();

}  // namespace etalon

// The differential fuzzer: random scenes, ordinary and hostile, rendered with the automatic plan, E
// and C, compared with each other and with the reference integrator.
//
//     render_fuzz SECONDS [SEED]
//
// Prints every violation with the seed that repeats it (render_fuzz 0 SEED runs that input alone),
// then the counts. Exit code 1 when there was a violation. A crash or an input that takes more than
// five minutes of CPU time ends the program with the seed on stderr.
#include <signal.h>
#include <sys/time.h>
#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <map>

#include "tests/fuzz/random_scenes.h"

namespace etalon::test {
namespace {

constexpr long max_input_cpu_s = 300;  // not waiting time: it may run beside other work
constexpr int shown_violations = 200;

volatile std::uint64_t current_seed = 0;

// Only what a signal handler may call.
void tell_seed(int signal_number) {
    char digits[24];
    int at = sizeof digits;
    digits[--at] = '\n';
    std::uint64_t seed = current_seed;
    do
        digits[--at] = static_cast<char>('0' + seed % 10);
    while ((seed /= 10) != 0);
    constexpr char words[] = "render_fuzz: crashed or hung at the seed ";
    if (write(STDERR_FILENO, words, sizeof words - 1) < 0 ||
        write(STDERR_FILENO, digits + at, sizeof digits - static_cast<std::size_t>(at)) < 0)
        _exit(3);
    _exit(signal_number == SIGPROF ? 2 : 3);
}

struct Worst {
    double gray = 0.0;
    std::uint64_t seed = 0;

    void see(std::optional<double> value, std::uint64_t of) {
        if (value && *value > gray)
            *this = {*value, of};
    }
};

struct Tally {
    long inputs = 0, rendered = 0, compared = 0, violations = 0;
    std::map<std::string, long> refusals;  // by their words, without numbers
    Worst methods, reference, slowest;
};

std::string without_numbers(const std::string& message) {
    std::string words;
    for (const char c : message.substr(0, message.find(':')))
        if (!std::isdigit(static_cast<unsigned char>(c)) && c != '.' && c != '-')
            words += c;
    return words.substr(0, 70);
}

bool is_hostile(std::uint64_t seed) {
    return seed / 16 % 2 == 1;
}

void report(Tally& tally, std::uint64_t seed, const std::string& rule, const std::string& details) {
    if (++tally.violations <= shown_violations)
        std::printf("VIOLATION seed %llu: %s: %s\n", static_cast<unsigned long long>(seed),
                    rule.c_str(), details.c_str());
    std::fflush(stdout);
}

// Half of the cameras are hostile; of every second scene some pixels are compared with the
// reference.
void fuzz_scene(std::uint64_t seed, KeptRenderer& kept, Tally& tally) {
    const auto start = std::chrono::steady_clock::now();
    const RandomInput input = is_hostile(seed) ? hostile_input(seed) : ordinary_input(seed);
    const SceneCheck check =
        check_scene_of(kept, input, seed % 2 ? 6 : 0, {.samples_per_scramble = 256, .rounds = 4});
    if (check.refusal.empty())
        ++tally.rendered;
    else
        ++tally.refusals[without_numbers(check.refusal)];
    if (!is_hostile(seed) && !check.refusal.empty())
        report(tally, seed, "ordinary scene refused", check.refusal);
    if (check.reference_gray)
        ++tally.compared;
    tally.methods.see(check.methods_gray, seed);
    tally.reference.see(check.reference_gray, seed);
    for (const Violation& violation : check.violations)
        report(tally, seed, violation.rule, violation.details);
    const std::chrono::duration<double> taken = std::chrono::steady_clock::now() - start;
    tally.slowest.see(taken.count(), seed);
}

void fuzz(std::uint64_t seed, KeptRenderer& kept, Tally& tally) {
    current_seed = seed;
    const itimerval limit{.it_interval = {}, .it_value = {.tv_sec = max_input_cpu_s, .tv_usec = 0}};
    setitimer(ITIMER_PROF, &limit, nullptr);
    ++tally.inputs;
    try {
        fuzz_scene(seed, kept, tally);
    } catch (const std::exception& error) {
        report(tally, seed, "exception", error.what());
    }
}

void print(const Tally& tally) {
    std::printf("%ld inputs: %ld rendered, %ld compared with the reference\n", tally.inputs,
                tally.rendered, tally.compared);
    for (const auto& [words, count] : tally.refusals)
        std::printf("  %8ld refused: %s\n", count, words.c_str());
    std::printf(
        "worst: E against C %.4f gray (seed %llu), reference %.4f gray beyond 4 s.e. "
        "(seed %llu), %.2f s (seed %llu)\n",
        tally.methods.gray, static_cast<unsigned long long>(tally.methods.seed),
        tally.reference.gray, static_cast<unsigned long long>(tally.reference.seed),
        tally.slowest.gray, static_cast<unsigned long long>(tally.slowest.seed));
    std::printf("%ld violations\n", tally.violations);
}

}  // namespace
}  // namespace etalon::test

int main(int argc, char** argv) {
    using namespace etalon::test;
    if (argc < 2 || argc > 3) {
        std::fprintf(stderr, "usage: render_fuzz SECONDS [SEED]\n");
        return 3;
    }
    const std::chrono::duration<double> duration(std::strtod(argv[1], nullptr));
    std::uint64_t seed = argc > 2 ? std::strtoull(argv[2], nullptr, 10) : 1;
    for (const int number : {SIGPROF, SIGSEGV, SIGABRT, SIGFPE, SIGBUS, SIGILL})
        signal(number, tell_seed);
    Tally tally;
    KeptRenderer kept;
    const auto start = std::chrono::steady_clock::now();
    do
        fuzz(seed++, kept, tally);
    while (std::chrono::steady_clock::now() - start < duration);
    print(tally);
    return tally.violations > 0 ? 1 : 0;
}

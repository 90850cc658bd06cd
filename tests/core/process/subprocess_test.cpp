#include "core/process/subprocess.h"

#include <sys/wait.h>

#include "tests/test.h"

namespace etalon {
namespace {

std::vector<std::string> shell(const std::string& script) {
    return {"sh", "-c", script};
}

SubprocessOptions with_input() {
    SubprocessOptions options;
    options.has_input = true;
    return options;
}

// Ended, or a zombie that nobody has reaped yet.
bool has_ended(int process) {
    std::ifstream stat("/proc/" + std::to_string(process) + "/stat");
    const std::string text{std::istreambuf_iterator<char>(stat), {}};
    const std::size_t name_end = text.rfind(')');  // "4711 (sleep) S ..."
    return name_end == std::string::npos || text.substr(name_end + 2, 1) == "Z";
}

void expect_end(int process) {
    for (int i = 0; i < 2000 && !has_ended(process); ++i)
        SteadyClock().wait_for(5ms, {});
    EXPECT_TRUE(has_ended(process)) << process;
}

TEST(Subprocess, TellsItsExitCodeItsOutputAndTheTailOfItsStderr) {
    const SubprocessResult result = run_subprocess(
        shell("for i in 1 2 3 4 5 6 7 8; do echo \"line $i\" >&2; done; echo seven; exit 7"));
    EXPECT_EQ(result.exit_code, 7);
    EXPECT_EQ(result.signal, 0);
    EXPECT_EQ(result.output, "seven\n");
    EXPECT_EQ(result.stderr_tail, "line 3\nline 4\nline 5\nline 6\nline 7\nline 8\n");
}

TEST(Subprocess, CallsWithEachLineOfStderrAndOnceWithTheEnd) {
    std::string lines;
    std::vector<int> ends;
    {
        SubprocessOptions options;
        options.on_stderr_line = [&](const std::string& line) { lines += "<" + line + ">"; };
        options.on_end = [&](const SubprocessResult& result) { ends.push_back(result.exit_code); };
        Subprocess process(shell("echo a >&2; printf b >&2; exit 3"), std::move(options));
        ASSERT_TRUE(process.wait_for(60s));
    }
    EXPECT_EQ(lines, "<a><b>");
    EXPECT_EQ(ends, std::vector{3});
}

TEST(Subprocess, NamesTheSignalThatEndedIt) {
    const SubprocessResult result = run_subprocess(shell("kill -SEGV $$"));
    EXPECT_EQ(result.exit_code, -1);
    EXPECT_EQ(result.signal, SIGSEGV);
}

TEST(Subprocess, SaysWhyItCannotBeStarted) {
    for (const auto& [program, cause] :
         {std::pair{"/nowhere/program", std::errc::no_such_file_or_directory},
          std::pair{"/etc", std::errc::permission_denied}}) {
        try {
            Subprocess process({program});
            ADD_FAILURE() << program;
        } catch (const std::system_error& error) {
            EXPECT_EQ(error.code(), cause) << program;
        }
    }
    const SubprocessResult result = run_subprocess({"no-such-program"});
    EXPECT_EQ(result.exit_code, -1);
    EXPECT_THAT(result.stderr_tail, HasSubstr("No such file"));
}

TEST(Subprocess, AnswersWhatIsWrittenUntilItsInputIsClosed) {
    Subprocess process({"cat"}, with_input());
    for (const std::string line : {"seven\n", "eight\n"}) {
        EXPECT_FALSE(process.write(line, 60s));
        std::string answer;
        while (answer.size() < line.size() && !process.has_closed_output())
            answer += process.read_output(60s);
        EXPECT_EQ(answer, line);
    }
    process.close_input();
    ASSERT_TRUE(process.wait_for(60s));
    EXPECT_EQ(process.result().exit_code, 0);
}

TEST(Subprocess, WritingToOneThatDoesNotReadTimesOutAndToOneThatEndedFails) {
    const std::string much(1u << 22, 'x');
    Subprocess deaf({"sleep", "60"}, with_input());
    EXPECT_EQ(deaf.write(much, 50ms), std::errc::timed_out);
    Subprocess ended({"true"}, with_input());
    ASSERT_TRUE(ended.wait_for(60s));
    EXPECT_EQ(ended.write("x", 60s), std::errc::broken_pipe);
}

TEST(Subprocess, IsWaitedForUntilTheTimeIsOverOrAStopIsRequested) {
    Subprocess process({"sleep", "60"});
    EXPECT_FALSE(process.wait_for(1ms));
    EXPECT_EQ(process.read_output(1ms), "");
    std::stop_source stop;
    stop.request_stop();
    EXPECT_FALSE(process.wait_for(no_time_limit, stop.get_token()));
    EXPECT_TRUE(process.send(SIGKILL));
    ASSERT_TRUE(process.wait_for(60s));
    EXPECT_FALSE(process.send(SIGKILL));
}

TEST(Subprocess, KeepsTheFirstMebibyteOfWhatNobodyTakes) {
    const SubprocessResult result = run_subprocess({"head", "-c", "3000000", "/dev/zero"});
    EXPECT_EQ(result.exit_code, 0);
    EXPECT_EQ(result.output.size(), 1u << 20);
}

TEST(Subprocess, EndsWithItsOwnerAndWithAllThatItStarted) {
    int shell_process = 0, sleeping = 0;
    {
        Subprocess process(shell("sleep 600 & echo $$ $!; wait"));
        std::string line;
        while (!line.ends_with('\n') && !process.has_closed_output())
            line += process.read_output(60s);
        ASSERT_EQ(std::sscanf(line.c_str(), "%d %d", &shell_process, &sleeping), 2) << line;
        EXPECT_FALSE(has_ended(sleeping));
    }
    EXPECT_TRUE(has_ended(shell_process));
    expect_end(sleeping);
}

// However that dies: here it is killed.
TEST(Subprocess, EndsWhenItsParentDies) {
    std::array<int, 2> ends{};
    ASSERT_EQ(pipe(ends.data()), 0);
    const pid_t parent = fork();
    if (parent == 0) {
        Subprocess process(shell("echo $$; exec sleep 600"));
        const std::string line = process.read_output(60s);
        [[maybe_unused]] const ssize_t count = write(ends[1], line.data(), line.size());
        kill(getpid(), SIGKILL);
    }
    close(ends[1]);
    std::array<char, 32> line{};
    ASSERT_GT(read(ends[0], line.data(), line.size() - 1), 0);
    close(ends[0]);
    waitpid(parent, nullptr, 0);
    ASSERT_GT(std::atoi(line.data()), 0);
    expect_end(std::atoi(line.data()));
}

// A descriptor without O_CLOEXEC, a blocked and an ignored signal.
TEST(Subprocess, InheritsNoFilesAndNoSignalMask) {
    constexpr int open_file = 77;
    ASSERT_EQ(dup2(STDOUT_FILENO, open_file), open_file);
    const auto before = std::signal(SIGPIPE, SIG_IGN);
    sigset_t blocked, old;
    sigemptyset(&blocked);
    sigaddset(&blocked, SIGUSR1);
    pthread_sigmask(SIG_BLOCK, &blocked, &old);
    EXPECT_NE(run_subprocess(shell("test -e /proc/$$/fd/77")).exit_code, 0);
    EXPECT_EQ(run_subprocess(shell("kill -PIPE $$; exit 5")).signal, SIGPIPE);
    EXPECT_EQ(run_subprocess(shell("kill -USR1 $$; exit 5")).signal, SIGUSR1);
    pthread_sigmask(SIG_SETMASK, &old, nullptr);
    std::signal(SIGPIPE, before);
    close(open_file);
}

TEST(Subprocess, ThisProgramIsTheOneThatRuns) {
    const SubprocessResult result = run_subprocess(this_program({"--gtest_list_tests"}));
    EXPECT_EQ(result.exit_code, 0) << result.stderr_tail;
    EXPECT_THAT(result.output, HasSubstr("ThisProgramIsTheOneThatRuns"));
}

}  // namespace
}  // namespace etalon

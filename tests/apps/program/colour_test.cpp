// Colours on terminals only: pipes, a pseudo terminal, NO_COLOR, --color.

#include <pty.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "apps/program/colour.hpp"
#include "tests/apps/program/program.hpp"
#include "tests/catch.hpp"

namespace colour_test {

using namespace orbid;
using namespace orbid::tests;

namespace {

/// What the program writes to a terminal of 80 columns that is its standard output and error.
std::string on_terminal(const std::vector<std::string>& arguments, const char* no_color, const char* term) {
    int terminal = -1;
    winsize size{24, 80, 0, 0};
    const pid_t process = ::forkpty(&terminal, nullptr, nullptr, &size);
    if (process == 0) {
        if (no_color != nullptr) ::setenv("NO_COLOR", no_color, 1);
        ::setenv("TERM", term, 1);
        std::vector<char*> words;
        std::string program = ORBID_PROGRAM;
        words.push_back(program.data());
        std::vector<std::string> copies = arguments;
        for (std::string& argument : copies)
            words.push_back(argument.data());
        words.push_back(nullptr);
        ::execv(program.c_str(), words.data());
        ::_exit(127);
    }
    std::string text;
    char buffer[4096];
    for (ssize_t count = 0; (count = ::read(terminal, buffer, sizeof(buffer))) > 0;)
        text.append(buffer, static_cast<std::size_t>(count));
    ::waitpid(process, nullptr, 0);
    ::close(terminal);
    return text;
}

bool has_colour(const std::string& text) {
    return text.find("\033[3") != std::string::npos;
}

}  // namespace

TEST_CASE("colours and bars appear on terminals only", "[apps][command]") {
    ::unsetenv("NO_COLOR");
    const TemporaryFolder folder;
    const std::vector<std::string> wrong{"check", write_text(folder.path() / "job.json", "{ \"modl\": 1 }")};
    CHECK(has_colour(on_terminal(wrong, nullptr, "xterm")));
    CHECK(has_colour(on_terminal(wrong, "", "xterm")));
    CHECK_FALSE(has_colour(on_terminal(wrong, "1", "xterm")));
    CHECK_FALSE(has_colour(on_terminal(wrong, nullptr, "dumb")));
    std::vector<std::string> with = wrong;
    with.insert(with.end(), {"--color", "never"});
    CHECK_FALSE(has_colour(on_terminal(with, nullptr, "xterm")));
    with.back() = "always";
    CHECK(has_colour(on_terminal(with, "1", "dumb")));
    // In this process, errors go to a file.
    CHECK_FALSE(has_colour(orbid_with(wrong).error));
    CHECK(has_colour(orbid_with(with).error));

    json job = pendulum_job(8192);
    job["orbits"]["periods"] = {1, 2};
    const Path file = write_job(folder.path() / "pendulum.json", job);
    const std::string shown = on_terminal({"run", file, "--out", folder.path() / "a"}, nullptr, "xterm");
    CHECK_THAT(shown, ContainsSubstring("\033[32mconverged\033[0m") && ContainsSubstring("\r\033[K"));
    const Outcome piped = orbid_with({"run", file, "--out", folder.path() / "b"});
    CHECK((piped.out + piped.error).find('\033') == std::string::npos);
    CHECK((piped.out + piped.error).find('\r') == std::string::npos);
    with = {"run", file, "--color", "purple"};
    CHECK_THAT(orbid_with(with).error, ContainsSubstring("auto, always, never"));
}

TEST_CASE("only statuses at the beginning of a line are coloured", "[apps][command]") {
    using apps::with_status_colours;
    CHECK(with_status_colours("a title\nfailed: no\n  converged: x\n", true) ==
          "a title\n\033[31mfailed\033[0m: no\n  converged: x\n");
    CHECK(with_status_colours("converged: x", false) == "converged: x");
    CHECK(apps::error_text("job.json:1:2: wrong", true) == "\033[31mjob.json:1:2:\033[0m wrong");
    CHECK(apps::error_text("nothing to mark", true) == "nothing to mark");
}

}  // namespace colour_test

#include "apps/job/compiler_run.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstdlib>
#include <string_view>
#include <system_error>
#include <thread>

#include <fmt/format.h>

extern char** environ;

namespace orbid::apps {

namespace {

std::optional<Compiler> identified(const std::filesystem::path& path) {
    std::error_code error;
    const auto real = std::filesystem::canonical(path, error);
    struct stat status {};
    if (error || stat(real.c_str(), &status) != 0 || !S_ISREG(status.st_mode) || access(real.c_str(), X_OK) != 0)
        return std::nullopt;
    return Compiler{std::filesystem::absolute(path), fmt::format("{} {} {}.{:09}", real.string(), status.st_size,
                                                                 status.st_mtim.tv_sec, status.st_mtim.tv_nsec)};
}

/// A program by its path, or by its name in $PATH.
std::optional<Compiler> program(const std::string& name) {
    if (name.find('/') != std::string::npos) return identified(name);
    const char* path = std::getenv("PATH");
    std::string_view folders = path != nullptr ? path : "/usr/bin:/bin";
    while (!folders.empty()) {
        const std::string_view folder = folders.substr(0, folders.find(':'));
        folders.remove_prefix(std::min(folder.size() + 1, folders.size()));
        if (folder.empty()) continue;
        if (auto found = identified(std::filesystem::path(folder) / name)) return found;
    }
    return std::nullopt;
}

}  // namespace

std::optional<Compiler> find_compiler() {
    if (const char* chosen = std::getenv("ORBID_CXX")) {
        if (*chosen == '\0') return std::nullopt;
        return program(chosen);
    }
    if (auto own = identified(ORBID_CXX_COMPILER)) return own;
    return program("c++");
}

ProgramEnd run_program(const std::filesystem::path& program, const std::vector<std::string>& arguments,
                       const std::filesystem::path& printed, const std::filesystem::path& temporary, double seconds) {
    std::vector<std::string> words{program.string()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words)
        argv.push_back(word.data());
    argv.push_back(nullptr);
    // Messages in English, temporary files where they may be.
    std::vector<std::string> variables{"LC_ALL=C", "TMPDIR=" + temporary.string()};
    for (char** variable = environ; variable != nullptr && *variable != nullptr; ++variable) {
        const std::string_view text(*variable);
        if (text.substr(0, 7) != "LC_ALL=" && text.substr(0, 7) != "TMPDIR=") variables.emplace_back(text);
    }
    std::vector<char*> environment;
    for (std::string& variable : variables)
        environment.push_back(variable.data());
    environment.push_back(nullptr);

    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    posix_spawn_file_actions_addopen(&actions, STDOUT_FILENO, printed.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
    posix_spawn_file_actions_adddup2(&actions, STDOUT_FILENO, STDERR_FILENO);
    ProgramEnd end;
    pid_t child = 0;
    end.started = posix_spawn(&child, program.c_str(), &actions, nullptr, argv.data(), environment.data()) == 0;
    posix_spawn_file_actions_destroy(&actions);
    if (!end.started) return end;
    const auto limit = std::chrono::steady_clock::now() + std::chrono::duration<double>(seconds);
    int status = 0;
    for (;;) {
        const pid_t waited = waitpid(child, &status, end.timed_out ? 0 : WNOHANG);
        if (waited == child) break;
        if (waited < 0 && errno != EINTR) return end;
        if (!end.timed_out && std::chrono::steady_clock::now() > limit) {
            end.timed_out = true;
            kill(child, SIGKILL);
        }
        // A compilation takes seconds: a look a hundred times a second is soon enough.
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    if (WIFEXITED(status)) end.exit_code = WEXITSTATUS(status);
    return end;
}

}  // namespace orbid::apps

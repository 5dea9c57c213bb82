#include "apps/report/plots/picture_file.hpp"

#include <fcntl.h>
#include <spawn.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <system_error>
#include <vector>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"

extern char** environ;  // POSIX declares it nowhere

namespace orbid::apps {

namespace {

constexpr std::string_view converter = "rsvg-convert";

/// A folder of our own that disappears with its content.
class WorkFolder {
public:
    WorkFolder() {
        std::string name = (std::filesystem::temp_directory_path() / "orbid-plot-XXXXXX").string();
        if (::mkdtemp(name.data()) == nullptr)
            throw PictureRefused(fmt::format("{}: cannot make a folder: {}", name, std::strerror(errno)));
        path_ = name;
    }
    ~WorkFolder() {
        std::error_code ignored;  // a destructor has nobody to tell
        std::filesystem::remove_all(path_, ignored);
    }
    WorkFolder(const WorkFolder&) = delete;
    WorkFolder& operator=(const WorkFolder&) = delete;

    [[nodiscard]] std::filesystem::path file(const char* name) const { return path_ / name; }

private:
    std::filesystem::path path_;
};

/// Runs the converter with its messages in a file.
/// @return its exit code; 127 also stands for a program that cannot be started.
int run_converter(const std::vector<std::string>& arguments, const std::filesystem::path& messages) {
    std::vector<char*> pointers;
    std::vector<std::string> copies = arguments;
    for (std::string& argument : copies)
        pointers.push_back(argument.data());
    pointers.push_back(nullptr);
    // A fixed date instead of the clock's: cairo writes it into PDF files.
    std::vector<char*> environment;
    std::string epoch = "SOURCE_DATE_EPOCH=0";
    for (char** entry = environ; *entry != nullptr; ++entry)
        if (std::string_view(*entry).substr(0, 18) != "SOURCE_DATE_EPOCH=") environment.push_back(*entry);
    environment.push_back(epoch.data());
    environment.push_back(nullptr);

    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    const std::string log = messages.string();
    posix_spawn_file_actions_addopen(&actions, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
    for (const int stream : {STDOUT_FILENO, STDERR_FILENO})
        posix_spawn_file_actions_addopen(&actions, stream, log.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
    pid_t child = 0;
    const int failure = ::posix_spawnp(&child, pointers[0], &actions, nullptr, pointers.data(), environment.data());
    posix_spawn_file_actions_destroy(&actions);
    constexpr int not_started = 127;
    if (failure != 0) return not_started;
    int status = 0;
    while (::waitpid(child, &status, 0) < 0) {
        if (errno != EINTR) return not_started;
    }
    return WIFEXITED(status) ? WEXITSTATUS(status) : 1;
}

}  // namespace

std::string picture_file(std::string_view svg, PictureFormat format, double dots_per_inch) {
    if (format == PictureFormat::svg) return std::string(svg);
    const std::string type = format == PictureFormat::pdf ? "pdf" : "png";
    const WorkFolder folder;
    const auto source = folder.file("plot.svg");
    const auto target = folder.file("plot.out");
    const auto messages = folder.file("messages");
    write_atomically(source, svg);
    std::vector<std::string> arguments{std::string(converter), "--format", type, "--output", target.string()};
    if (format == PictureFormat::png) {
        const std::string dots = fmt::format("{:g}", dots_per_inch);
        arguments.insert(arguments.end(), {"--dpi-x", dots, "--dpi-y", dots});
    }
    arguments.push_back(source.string());
    const int code = run_converter(arguments, messages);
    constexpr int not_started = 127;
    if (code == not_started)
        throw PictureRefused(
            fmt::format("{} files are made by {}, which was not found; install it (Debian: apt install librsvg2-bin), "
                        "or take --format svg",
                        type == "pdf" ? "PDF" : "PNG", converter));
    if (code != 0 || !std::filesystem::exists(target)) {
        std::string said = std::filesystem::exists(messages) ? read_whole_file(messages) : std::string();
        while (!said.empty() && said.back() == '\n')
            said.pop_back();
        throw PictureRefused(fmt::format("{} ended with code {}: {}", converter, code, said));
    }
    return read_whole_file(target);
}

}  // namespace orbid::apps

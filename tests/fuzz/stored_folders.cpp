// Stored folders of runs with one file changed, through every command that reads them.
//
//     stored_folders WORK COUNT SEED FOLDER... [--show N]
//
// Each FOLDER is the output folder of a finished run, made by stored_folders.py; "predict.txt" in it names a record to
// predict. Of each mutation an own copy is made below WORK. The commands are called within a child process, which is
// replaced when it dies: report, plot (the list and one plot), compare (both ways), predict, and run, which goes on
// with the folder. A signal, a call that takes more than half a minute and an exception that leaves a command (the
// program would call it an internal error) are findings. Exit code 1 if there are any.
#include <fcntl.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include <fmt/format.h>

#include "apps/program/command_line.hpp"
#include "tests/fuzz/mutation.hpp"

namespace {

namespace fs = std::filesystem;
using orbid::fuzz::Mutation;

constexpr unsigned seconds_at_most = 30;
constexpr rlim_t memory_at_most = rlim_t{6} << 30;  // of addresses; what is used is a small part of them

struct Base {
    fs::path folder;
    std::vector<fs::path> files;
    std::vector<std::string> plots;
    std::string record;  ///< to predict; empty: none
};

std::string content(const fs::path& file) {
    std::ifstream stream(file, std::ios::binary);
    return {std::istreambuf_iterator<char>(stream), {}};
}

/// What a command did: nothing is told but an exception that leaves it.
std::string called(const std::vector<std::string>& arguments, std::string* output = nullptr) {
    std::ostringstream out, error;
    try {
        (void)orbid::apps::run_command(arguments, out, error, {});
    } catch (const std::exception& thrown) {
        return fmt::format("{}: {}", arguments.front(), thrown.what());
    }
    if (output != nullptr) *output = out.str();
    return {};
}

Base base_of(const fs::path& folder) {
    Base base{folder, {}, {}, {}};
    for (const auto& entry : fs::directory_iterator(folder))
        if (entry.is_regular_file() && entry.path().filename() != "predict.txt") base.files.push_back(entry.path());
    std::sort(base.files.begin(), base.files.end());
    std::string list;
    called({"plot", folder.string()}, &list);
    std::istringstream lines(list);
    for (std::string line; std::getline(lines, line);)
        if (std::string name; std::istringstream(line) >> name && name != "plot") base.plots.push_back(name);
    base.record = content(folder / "predict.txt");
    while (!base.record.empty() && base.record.back() == '\n')
        base.record.pop_back();
    return base;
}

/// All commands on a copy of a folder with one file changed; empty, or the finding.
std::string tried(const Base& base, const fs::path& work, std::uint64_t seed, std::string& file) {
    std::mt19937_64 random(seed);
    const fs::path folder = work / "run";
    fs::remove_all(folder);
    fs::create_directories(folder);
    const fs::path& changed = base.files[random() % base.files.size()];
    file = changed.filename().string();
    for (const fs::path& each : base.files)
        if (each != changed) fs::create_hard_link(each, folder / each.filename());
    std::ofstream(folder / file, std::ios::binary) << Mutation(random).of(content(changed), changed.extension());
    const std::string name = folder.string();
    std::vector<std::vector<std::string>> commands{{"report", name},
                                                   {"plot", name},
                                                   {"compare", name, base.folder.string()},
                                                   {"compare", base.folder.string(), name}};
    if (!base.plots.empty()) commands.push_back({"plot", name, base.plots[random() % base.plots.size()]});
    if (!base.record.empty()) commands.push_back({"predict", name, base.record, "--quiet", "--force"});
    commands.push_back({"run", (base.folder.parent_path() / (base.folder.filename().string() + ".json")).string(),
                        "--out", name, "--quiet", "--force", "--threads", "1"});
    for (const auto& command : commands) {
        ::alarm(seconds_at_most);
        if (std::string what = called(command); !what.empty()) return what;
    }
    ::alarm(0);
    return {};
}

/// Shared by the child that works and the parent that survives it.
struct Progress {
    std::uint64_t done = 0;
    char file[64] = {};
};

}  // namespace

int main(int count, char** words) {
    if (count < 5) {
        std::fprintf(stderr, "usage: stored_folders WORK COUNT SEED FOLDER...\n");
        return 2;
    }
    const fs::path work = words[1];
    const std::uint64_t wanted = std::strtoull(words[2], nullptr, 10), first = std::strtoull(words[3], nullptr, 10);
    std::vector<fs::path> folders(words + 4, words + count);
    auto* shared = static_cast<Progress*>(
        ::mmap(nullptr, sizeof(Progress), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0));
    *shared = {};
    std::uint64_t findings = 0;
    while (shared->done < wanted) {
        const pid_t child = ::fork();
        if (child == 0) {
            const rlimit memory{memory_at_most, memory_at_most};
            ::setrlimit(RLIMIT_AS, &memory);
            std::vector<Base> bases;
            for (const fs::path& folder : folders)
                bases.push_back(base_of(folder));
            std::uint64_t told = 0;
            while (shared->done < wanted) {
                const std::uint64_t seed = first + shared->done;
                std::string file;
                const std::string what = tried(bases[seed % bases.size()], work, seed, file);
                ++shared->done;
                if (what.empty()) continue;
                ++told;
                std::printf("%s seed %llu, %s: %s\n", bases[seed % bases.size()].folder.filename().c_str(),
                            static_cast<unsigned long long>(seed), file.c_str(), what.substr(0, 300).c_str());
                std::fflush(stdout);
            }
            ::_exit(static_cast<int>(std::min<std::uint64_t>(told, 100)));
        }
        int status = 0;
        ::waitpid(child, &status, 0);
        if (WIFEXITED(status)) {
            findings += static_cast<std::uint64_t>(WEXITSTATUS(status));
        } else {
            std::printf("seed %llu: ended by signal %d\n", static_cast<unsigned long long>(first + shared->done),
                        WTERMSIG(status));
            std::fflush(stdout);
            ++findings;
            ++shared->done;
        }
    }
    std::printf("%llu stored folders with one file changed, %llu findings\n", static_cast<unsigned long long>(wanted),
                static_cast<unsigned long long>(findings));
    return findings == 0 ? 0 : 1;
}

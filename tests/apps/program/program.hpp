#pragma once

#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

#include "apps/documents/atomic_file.hpp"
#include "apps/program/command_line.hpp"
#include "tests/apps/program/temporary_folder.hpp"

namespace orbid::tests {

using nlohmann::json;
using Path = std::filesystem::path;

/// Sends one of the standard streams into a file while it lives: what is printed by any means is caught.
class CaughtStream {
public:
    CaughtStream(int descriptor, const Path& file) : descriptor_(descriptor), file_(file) {
        flush();
        former_ = ::dup(descriptor_);
        std::FILE* opened = std::fopen(file_.c_str(), "w");
        ::dup2(::fileno(opened), descriptor_);
        std::fclose(opened);
    }
    ~CaughtStream() { finish(); }
    CaughtStream(const CaughtStream&) = delete;
    CaughtStream& operator=(const CaughtStream&) = delete;

    std::string finish() {
        if (former_ >= 0) {
            flush();
            ::dup2(former_, descriptor_);
            ::close(former_);
            former_ = -1;
        }
        return apps::read_whole_file(file_);
    }

private:
    static void flush() {
        std::cout.flush();
        std::cerr.flush();
        std::fflush(stdout);
        std::fflush(stderr);
    }

    int descriptor_;
    int former_ = -1;
    Path file_;
};

struct Outcome {
    int code = -1;
    std::string out;
    std::string error;
};

/// Runs the program in this process.
inline Outcome orbid_with(const std::vector<std::string>& arguments) {
    const TemporaryFolder folder;
    CaughtStream out(STDOUT_FILENO, folder.path() / "out");
    CaughtStream error(STDERR_FILENO, folder.path() / "error");
    Outcome outcome;
    outcome.code = apps::run_command(arguments);
    outcome.out = out.finish();
    outcome.error = error.finish();
    return outcome;
}

inline json read_json(const Path& file) {
    return json::parse(apps::read_whole_file(file));
}

inline Path write_text(const Path& file, const std::string& text) {
    std::ofstream(file, std::ios::binary) << text;
    return file;
}

inline Path write_job(const Path& file, const json& job) {
    return write_text(file, job.dump(2));
}

/// Every file of a folder with its bytes.
inline std::map<std::string, std::string> content(const Path& folder) {
    std::map<std::string, std::string> files;
    for (const auto& entry : std::filesystem::directory_iterator(folder)) {
        files[entry.path().filename().string()] = apps::read_whole_file(entry.path());
    }
    return files;
}

/// The simulated pendulum of the paper: a section series, its cycles, and length and frictions from them.
inline json pendulum_job(int sections = 16384) {
    json job = json::parse(R"({
      "title": "a short pendulum",
      "model": { "name": "parametric_pendulum", "variant": "crank" },
      "seed": 1,
      "data": { "name": "run1", "simulate": { "sections": 0, "trajectories": 4 } },
      "orbits": { "periods": [1, 2, 3] },
      "estimate": {
        "parameters": { "l": { "start": 0.33 }, "k2": { "start": 6e-4 }, "k3": { "start": 2.2e-4 } },
        "derived": { "k2_over_m": "k2 / m" },
        "residuals": [ { "type": "cycles" } ] },
      "reference": { "l": 0.317, "k2_over_m": 5.652680652680653e-3 } })");
    job["data"]["simulate"]["sections"] = sections;
    return job;
}

}  // namespace orbid::tests

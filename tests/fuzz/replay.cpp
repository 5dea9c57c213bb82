// Gives every file of corpus/TARGET to its target, without libFuzzer: what was once found stays mended.
//
//     fuzz_replay CORPUS
#include <algorithm>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "tests/fuzz/target.hpp"

int main(int count, char** words) {
    namespace fs = std::filesystem;
    if (count != 2) {
        std::fprintf(stderr, "usage: fuzz_replay CORPUS\n");
        return 2;
    }
    bool failed = false;
    for (const orbid::fuzz::Target& target : orbid::fuzz::all_targets()) {
        const fs::path folder = fs::path(words[1]) / target.name;
        std::vector<fs::path> files;
        if (fs::is_directory(folder))
            for (const auto& entry : fs::directory_iterator(folder))
                files.push_back(entry.path());
        std::sort(files.begin(), files.end());
        for (const fs::path& file : files) {
            // A crash names its file by this line.
            std::printf("%s\n", file.c_str());
            std::fflush(stdout);
            std::ifstream stream(file, std::ios::binary);
            const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
            try {
                target.take(bytes);
            } catch (const std::exception& error) {
                std::printf("FAILED: an exception leaves the target: %s\n", error.what());
                failed = true;
            }
        }
        std::printf("%s: %zu inputs\n", std::string(target.name).c_str(), files.size());
        failed = failed || files.empty();  // a corpus that is not found tests nothing
    }
    return failed ? 1 : 0;
}

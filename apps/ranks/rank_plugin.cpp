#include "apps/ranks/rank_plugin.hpp"

#include <dlfcn.h>

#include <charconv>
#include <cstdlib>
#include <filesystem>
#include <optional>
#include <string_view>
#include <vector>

#include <fmt/format.h>

#include "apps/job/version.hpp"

namespace orbid::apps {
namespace {

namespace fs = std::filesystem;

constexpr const char* plugin_name = "orbid-mpi.so";

std::optional<int> number_in(const char* variable) {
    const char* const value = std::getenv(variable);
    if (value == nullptr) return std::nullopt;
    const std::string_view text(value);
    int number = 0;
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), number);
    if (error != std::errc() || end != text.data() + text.size()) return std::nullopt;
    return number;
}

/// How many ranks were started, where the starter says so: Open MPI, PMI (MPICH, Intel MPI, Slurm), Slurm.
std::optional<int> started_ranks() {
    for (const char* variable : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_STEP_NUM_TASKS"})
        if (const auto size = number_in(variable)) return size;
    return std::nullopt;
}

/// Where the plug-in may lie: in a folder that the user names, beside the library, of which there is one for each level
/// of instructions in lib/glibc-hwcaps/LEVEL, or in lib beside the folder of a program that the library is part of.
std::vector<fs::path> candidates() {
    std::vector<fs::path> files;
    if (const char* folder = std::getenv("ORBID_PLUGINS"); folder != nullptr && *folder != '\0')
        files.push_back(fs::path(folder) / plugin_name);
    Dl_info library{};
    std::error_code error;
    if (dladdr(reinterpret_cast<const void*>(&under_mpi), &library) == 0 || library.dli_fname == nullptr) return files;
    const fs::path file = fs::canonical(library.dli_fname, error);
    if (error) return files;
    const fs::path folder = file.parent_path();
    files.push_back(folder / "orbid" / plugin_name);
    if (folder.parent_path().filename() == "glibc-hwcaps")
        files.push_back(folder.parent_path().parent_path() / "orbid" / plugin_name);
    files.push_back(folder.parent_path() / "lib" / "orbid" / plugin_name);
    return files;
}

fs::path found_plugin() {
    std::error_code error;
    for (const fs::path& file : candidates())
        if (fs::is_regular_file(file, error)) return file;
    const auto size = started_ranks();
    const char* const folder = std::getenv("ORBID_PLUGINS");
    throw NoMpi(fmt::format(
        "this program was started by mpiexec{}, but orbid's MPI plug-in is not installed: apt install "
        "orbid-mpi (or build with libopenmpi-dev){}",
        size ? fmt::format(" with {} ranks", *size) : std::string(),
        folder != nullptr ? fmt::format("; $ORBID_PLUGINS, {}, holds no {}", folder, plugin_name) : std::string()));
}

const RankPlugin& loaded(const fs::path& file) {
    // Kept until the program ends. Components of some versions of Open MPI find its symbols only where all see them.
    void* const library = dlopen(file.c_str(), RTLD_NOW | RTLD_GLOBAL);
    if (library == nullptr)
        throw NoMpi(fmt::format("{} cannot be loaded: {}; MPI itself is in Debian's package openmpi-bin", file.string(),
                                dlerror()));
    const auto entry = reinterpret_cast<RankPluginEntry>(dlsym(library, rank_plugin_entry));
    if (entry == nullptr) throw NoMpi(fmt::format("{} is no plug-in of orbid", file.string()));
    const RankPlugin& plugin = *entry();
    if (plugin.version != RankPlugin::current || plugin.program_version != program_version())
        throw NoMpi(
            fmt::format("{} belongs to another version of orbid; this is {}", file.string(), program_version()));
    return plugin;
}

}  // namespace

bool under_mpi() {
    for (const char* variable : {"OMPI_COMM_WORLD_SIZE", "PMIX_RANK", "PMI_RANK", "PMI_SIZE"})
        if (std::getenv(variable) != nullptr) return true;
    // Slurm without PMI: no MPI can work, but each of the programs would believe to be alone.
    return number_in("SLURM_STEP_NUM_TASKS").value_or(1) > 1;
}

std::unique_ptr<estimator::Ranks> mpi_ranks() {
    std::unique_ptr<estimator::Ranks> ranks(loaded(found_plugin()).ranks());
    if (const auto size = started_ranks(); size && *size != ranks->count())
        throw NoMpi(fmt::format(
            "{} ranks were started, but MPI knows of {}: the program was started by another MPI than the one "
            "that the plug-in was built with (Slurm: srun --mpi=pmix)",
            *size, ranks->count()));
    return ranks;
}

}  // namespace orbid::apps

#include "apps/job/model_plugin.hpp"

#include <dlfcn.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <stdexcept>
#include <vector>

#include <fmt/format.h>

#include "apps/documents/atomic_file.hpp"
#include "apps/documents/fingerprint.hpp"
#include "apps/job/compiler_run.hpp"
#include "apps/job/version.hpp"
#include "models/equations/equation_source.hpp"
#include "models/equations/named_kernel.hpp"
#include "models/system/processor_level.hpp"

namespace orbid::apps {

// Written by the build (cmake/model_headers.cmake): the headers that this program was compiled with, up to a null, and
// their SHA-256.
extern const char* const model_headers_sha256;
extern const char* const model_headers[];

namespace {

namespace fs = std::filesystem;

/// Something is missing or wrong on this machine; what() goes into `why`.
class NoPlugin : public std::runtime_error {
    using std::runtime_error::runtime_error;
};

// A model of a few equations takes ten to twenty seconds; what takes ten times as long would not pay.
constexpr double longest_compilation_s = 240.0;
constexpr std::size_t digest_length = 64;

/// As cmake/model_headers.cmake computes it; nothing where one of the headers is not there.
std::optional<std::string> digest_of_headers(const fs::path& folder) {
    std::string text;
    for (const char* const* file = model_headers; *file != nullptr; ++file) {
        std::error_code missing;
        if (!fs::is_regular_file(folder / *file, missing)) return std::nullopt;
        text += fmt::format("{} {}\n", *file, sha256_of_file(folder / *file));
    }
    return sha256(text);
}

/// Folder that holds models/ as this library was compiled with it: include/orbid of the prefix that the library (or the
/// program that it is part of) lies in, however deep; in a build folder a link of that name leads to the source.
fs::path headers_folder() {
    std::error_code error;
    std::vector<fs::path> candidates;
    Dl_info library{};
    if (dladdr(&model_headers_sha256, &library) != 0 && library.dli_fname != nullptr) {
        const fs::path file = fs::canonical(library.dli_fname, error);
        // lib, its folder of the architecture, glibc-hwcaps and the level: four folders; a package of Python is as
        // deep.
        constexpr int deepest = 6;
        fs::path folder = file.parent_path();
        for (int depth = 0; !error && depth < deepest && folder != folder.parent_path(); ++depth) {
            folder = folder.parent_path();
            candidates.push_back(folder / "include" / "orbid");
        }
    }
    fs::path other;
    for (const fs::path& folder : candidates) {
        const auto digest = digest_of_headers(folder);
        if (digest == model_headers_sha256) return folder;
        if (digest && other.empty()) other = folder;
    }
    if (!other.empty())
        throw NoPlugin(fmt::format("the headers in {} are not those that this orbid was built with", other.string()));
    throw NoPlugin(
        "orbid's headers are not installed beside it (Debian: package liborbid-dev; else component development of "
        "cmake --install)");
}

/// What code for "this machine" depends on, where the file system may be shared by several.
std::string processor() {
    std::ifstream file("/proc/cpuinfo");
    std::string line, text;
    while (std::getline(file, line) && !line.empty())
        if (line.rfind("model name", 0) == 0 || line.rfind("flags", 0) == 0 || line.rfind("Features", 0) == 0)
            text += line + "\n";
    return text;
}

std::vector<std::string> flags(const fs::path& headers) {
    std::vector<std::string> words{"-std=c++20",          "-O3",   "-DNDEBUG", "-ffp-contract=off", "-fPIC", "-shared",
                                   "-fvisibility=hidden", "-pipe", "-w"};
    // As the models of the library that was loaded: numbers do not depend on whether equations are compiled with them.
    if (const std::string machine = models::compiled_machine(); !machine.empty()) words.push_back("-march=" + machine);
    words.push_back("-I" + headers.string());
    // A compiler's own folder must keep its place in its list.
    if (const std::string xsimd = ORBID_XSIMD; xsimd != "/usr/include") {
        words.emplace_back("-isystem");
        words.push_back(xsimd);
    }
    return words;
}

/// The cache as a folder of ours that nobody else can write to.
fs::path prepared_cache() {
    const auto cache = plugin_cache();
    if (!cache) throw NoPlugin("there is no folder for a cache: neither $XDG_CACHE_HOME nor $HOME is set");
    std::error_code error;
    fs::create_directories(cache->parent_path(), error);
    if (mkdir(cache->c_str(), 0700) != 0 && errno != EEXIST)
        throw NoPlugin(
            fmt::format("the cache {} cannot be made: {}", cache->string(), std::generic_category().message(errno)));
    struct stat status {};
    if (lstat(cache->c_str(), &status) != 0 || !S_ISDIR(status.st_mode) || status.st_uid != geteuid() ||
        (status.st_mode & (S_IWGRP | S_IWOTH)) != 0)
        throw NoPlugin(fmt::format("the cache {} is not a folder that only you can write to", cache->string()));
    remove_leftover_temporaries(*cache);
    return *cache;
}

struct Recipe {
    std::string source;
    Compiler compiler;
    std::vector<std::string> flags;
    std::string key;
    fs::path file;  ///< in the cache
};

Recipe recipe_for(const models::Equations& equations) {
    Recipe recipe;
    std::string why;
    const auto source = models::equation_source(equations, why);
    if (!source) throw NoPlugin("not compiled: " + why);
    recipe.source = *source;
    const auto compiler = find_compiler();
    if (!compiler) throw NoPlugin("no C++ compiler was found (the one that built orbid, $ORBID_CXX, c++)");
    recipe.compiler = *compiler;
    const fs::path headers = headers_folder();
    const std::string digest = model_headers_sha256;
    recipe.flags = flags(headers);
    std::string all = recipe.source;
    for (const std::string& part : {program_version(), digest, compiler->identity, processor()})
        all += '\0' + part;
    for (const std::string& flag : recipe.flags)
        all += '\0' + flag;
    recipe.key = sha256(all);
    recipe.file = prepared_cache() / (recipe.key + ".so");
    return recipe;
}

/// True for a file of ours that holds its own SHA-256 at its end.
bool is_whole(const fs::path& file) {
    struct stat status {};
    if (lstat(file.c_str(), &status) != 0 || !S_ISREG(status.st_mode) || status.st_uid != geteuid() ||
        (status.st_mode & (S_IWGRP | S_IWOTH)) != 0)
        return false;
    std::string bytes;
    try {
        bytes = read_whole_file(file);
    } catch (const std::runtime_error&) {
        return false;
    }
    if (bytes.size() <= digest_length) return false;
    const std::size_t code = bytes.size() - digest_length;
    return sha256(std::string_view(bytes).substr(0, code)) == std::string_view(bytes).substr(code);
}

/// A folder for what a compilation leaves behind, removed with this object.
class TemporaryFolder {
public:
    explicit TemporaryFolder(const fs::path& cache) {
        // Named as the temporaries of files are: what a killed program left is removed like them.
        std::string name = (cache / (temporary_start() + "XXXXXX")).string();
        if (mkdtemp(name.data()) == nullptr)
            throw NoPlugin(fmt::format("the cache {} cannot be written: {}", cache.string(),
                                       std::generic_category().message(errno)));
        path_ = name;
    }
    ~TemporaryFolder() {
        std::error_code error;
        fs::remove_all(path_, error);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    [[nodiscard]] const fs::path& path() const { return path_; }

private:
    fs::path path_;
};

std::string first_line(const fs::path& file) {
    std::ifstream stream(file);
    std::string line;
    std::getline(stream, line);
    return line.substr(0, 200);
}

void compile(const Recipe& recipe) {
    const TemporaryFolder folder(recipe.file.parent_path());
    const fs::path source = folder.path() / "model.cpp", code = folder.path() / "model.so",
                   printed = folder.path() / "printed";
    write_atomically(source, recipe.source);
    std::vector<std::string> arguments = recipe.flags;
    arguments.insert(arguments.end(), {"-o", code.string(), source.string()});
    const ProgramEnd end = run_program(recipe.compiler.path, arguments, printed, folder.path(), longest_compilation_s);
    if (end.timed_out)
        throw NoPlugin(fmt::format("{} did not end within {} s", recipe.compiler.path.string(), longest_compilation_s));
    if (!end.succeeded())
        throw NoPlugin(fmt::format("{} failed: {}", recipe.compiler.path.string(), first_line(printed)));
    std::string bytes = read_whole_file(code);
    bytes += sha256(bytes);
    write_atomically(recipe.file, bytes);
    // Whatever the umask allows others.
    chmod(recipe.file.c_str(), 0600);
}

std::shared_ptr<const models::Kernel> loaded(const fs::path& file) {
    // Kept until the program ends: kernels, and what they made, may live as long.
    void* const library = dlopen(file.c_str(), RTLD_NOW | RTLD_LOCAL);
    if (library == nullptr) throw NoPlugin(fmt::format("{} cannot be loaded: {}", file.string(), dlerror()));
    using Entry = const models::Kernel* (*)();
    const auto entry = reinterpret_cast<Entry>(dlsym(library, models::equation_entry));
    if (entry == nullptr) throw NoPlugin(fmt::format("{} is no compiled model", file.string()));
    return {entry(), [](const models::Kernel*) {}};
}

}  // namespace

std::optional<fs::path> plugin_cache() {
    // Relative paths are to be ignored (XDG base directory specification).
    if (const char* cache = std::getenv("XDG_CACHE_HOME"); cache != nullptr && cache[0] == '/')
        return fs::path(cache) / "orbid";
    if (const char* home = std::getenv("HOME"); home != nullptr && home[0] == '/')
        return fs::path(home) / ".cache" / "orbid";
    return std::nullopt;
}

CompiledModel compiled_model(const std::shared_ptr<const models::Equations>& equations) {
    CompiledModel model;
    try {
        const Recipe recipe = recipe_for(*equations);
        model.cached = is_whole(recipe.file);
        if (!model.cached) compile(recipe);
        model.kernel = std::make_shared<models::NamedKernel>(equations, loaded(recipe.file));
    } catch (const std::runtime_error& error) {
        // Files, folders and compilers of the machine; without them equations are interpreted.
        model.why = error.what();
    }
    return model;
}

CompiledModelState compiled_model_state(const models::Equations& equations) {
    try {
        return {true, is_whole(recipe_for(equations).file), {}};
    } catch (const std::runtime_error& error) {
        return {false, false, error.what()};
    }
}

}  // namespace orbid::apps

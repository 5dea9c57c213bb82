#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include "models/equations/equations.hpp"
#include "models/system/kernel.hpp"

namespace orbid::apps {

/// A model written in a job as compiled code, or why there is none.
struct CompiledModel {
    std::shared_ptr<const models::Kernel> kernel;  ///< nothing: `why` says what is missing
    bool cached = false;                           ///< found in the cache, nothing was compiled
    std::string why;
};

/// Where compiled models are kept: $XDG_CACHE_HOME/orbid, else ~/.cache/orbid; nothing without a home.
[[nodiscard]] std::optional<std::filesystem::path> plugin_cache();

/// The compiled code of a model: from the cache, else compiled into it.
///
/// The name of a file in the cache is the SHA-256 of all that it depends on: source, version of orbid, content of its
/// headers, compiler, flags, processor. A file holds its own SHA-256 at its end; one that does not fit is made anew.
/// Files appear whole, in a folder that nobody else may write to; nothing is written outside of it. Never throws.
[[nodiscard]] CompiledModel compiled_model(const std::shared_ptr<const models::Equations>& equations);

/// Whether compiled_model() would find the model in the cache (true), could compile it (false), or why neither.
struct CompiledModelState {
    bool possible = false;
    bool cached = false;
    std::string why;
};
[[nodiscard]] CompiledModelState compiled_model_state(const models::Equations& equations);

}  // namespace orbid::apps

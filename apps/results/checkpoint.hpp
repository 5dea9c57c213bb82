#pragma once

#include <optional>
#include <string>
#include <string_view>

#include "apps/documents/fingerprint.hpp"
#include "apps/results/checkpoint_archive.hpp"
#include "apps/results/output_folder.hpp"

namespace orbid::apps {

/// What a run has finished within its estimate, in `checkpoint.bin` of the folder: a killed or interrupted run
/// continues from it and ends with the same bytes as an undisturbed one. It is removed when the estimate is complete.
///
/// A file with another fingerprint, of another program, or unreadable counts as absent. What is kept stands in the file
/// alone: of a long series it would take a tenth of the memory of the estimate.
class Checkpoint {
public:
    /// @param fingerprint  of what the estimate depends on.
    Checkpoint(OutputFolder& folder, const Fingerprint& fingerprint);

    /// Reads the value stored under a name.
    /// @return whether it exists.
    template <class T>
    [[nodiscard]] bool recall(const std::string& name, T& value) const {
        const std::optional<std::string> bytes = find(name);
        if (!bytes) return false;
        try {
            Archive archive{std::string_view(*bytes)};
            archive(value);
            if (archive.at_end()) return true;
        } catch (const DamagedCheckpoint&) {
            // Stored by a build with other layouts of values: computed again.
        }
        value = T{};
        return false;
    }

    /// Stores a value under a name, in place of the one that it has; it is complete in the folder when this returns.
    template <class T>
    void keep(const std::string& name, T& value) {
        std::string bytes;
        Archive archive(bytes);
        archive(value);
        keep_bytes(name, bytes);
    }

    /// Removes the file at the end.
    void remove();

private:
    [[nodiscard]] std::string content() const;
    [[nodiscard]] std::optional<std::string> find(const std::string& name) const;
    void keep_bytes(std::string name, std::string& bytes);

    OutputFolder& folder_;
    std::string head_;  ///< of the file: room for its hash, and the fingerprint
};

}  // namespace orbid::apps

#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace orbid::apps {

/// SHA-256 of bytes, 64 lower-case hexadecimal digits (FIPS 180-4, computed by OpenSSL).
[[nodiscard]] std::string sha256(std::string_view bytes);

/// SHA-256 of a file, read in pieces: large files cost no memory.
/// @throws std::runtime_error naming path and reason.
[[nodiscard]] std::string sha256_of_file(const std::filesystem::path& path);

/// What the file of a stage depends on: job keys (as JSON Pointers) and data, each with its value as text, and the hash
/// over all.
struct Fingerprint {
    std::string sha256;
    std::vector<std::pair<std::string, std::string>> keys;
};

/// Fingerprint of (key, value text) pairs, in the order given. Lengths are hashed too, so that different lists of pairs
/// never give the same text.
/// @throws std::invalid_argument on a duplicate key: compare() could not name it.
[[nodiscard]] Fingerprint fingerprint(std::vector<std::pair<std::string, std::string>> keys);

/// A key in which two fingerprints differ; nothing where a side lacks the key.
struct FingerprintDifference {
    std::string key;
    std::optional<std::string> first;
    std::optional<std::string> second;
};

/// The first key of `first` whose value differs in `second` or is missing there, else the first key only `second` has;
/// empty when the hashes are equal. Equal keys under different hashes (a damaged file) give the key "sha256".
[[nodiscard]] std::optional<FingerprintDifference> compare(const Fingerprint& first, const Fingerprint& second);

/// In words: `/data/simulate/sections is 1024 in the file, 2048 in the job`.
[[nodiscard]] std::string description(const FingerprintDifference& difference, std::string_view first_is = "the file",
                                      std::string_view second_is = "the job");

/// Fingerprint as one line of JSON, for attributes of HDF5 files and comments of CSV files.
[[nodiscard]] std::string to_text(const Fingerprint& value);

/// Inverse of to_text.
/// @return nothing when the text is not a fingerprint or its hash does not fit its keys: such a file is stale.
[[nodiscard]] std::optional<Fingerprint> fingerprint_from_text(std::string_view text);

}  // namespace orbid::apps

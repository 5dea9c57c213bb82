#pragma once

namespace orbid::apps {

// Exit codes of the program, see interfaces.md.
inline constexpr int success = 0;
inline constexpr int no_valid_answer = 1;
inline constexpr int wrong_call = 2;
inline constexpr int unusable_data = 3;
inline constexpr int not_stored = 4;
inline constexpr int interrupted = 130;

}  // namespace orbid::apps

// A shutter box: closes a camera's remote-release contact when the computer asks for it.
// The line protocol and the wiring are in README.md beside this file. Any Arduino will do.

const uint8_t FOCUS_PIN = 6;
const uint8_t SHUTTER_PIN = 7;
const unsigned long BAUD = 115200;
// Most cameras ignore a full press that no half press came before.
const unsigned long FOCUS_LEAD_MS = 30;
const unsigned long LONGEST_MS = 3600000;

const uint8_t LINE_SIZE = 40;
const uint8_t ANSWER_SIZE = 32;

char line[LINE_SIZE];
uint8_t length = 0;
bool inLine = false;

bool greeted = false;
char lastNumber[3] = "";
char lastAnswer[ANSWER_SIZE] = "";

// CRC-16 with polynomial 0x1021 and start 0xFFFF.
uint16_t crc16(const char *text, uint8_t size) {
  uint16_t crc = 0xFFFF;
  for (uint8_t place = 0; place < size; place++) {
    crc ^= (uint16_t)(uint8_t)text[place] << 8;
    for (uint8_t bit = 0; bit < 8; bit++) {
      crc = crc & 0x8000 ? (crc << 1) ^ 0x1021 : crc << 1;
    }
  }
  return crc;
}

void writeHex(char *text, uint16_t value) {
  for (int8_t digit = 3; digit >= 0; digit--) {
    text[digit] = "0123456789ABCDEF"[value & 0xF];
    value >>= 4;
  }
}

bool isHexDigit(char letter) {
  return (letter >= '0' && letter <= '9') || (letter >= 'A' && letter <= 'F');
}

void answer(const char *number, const char *text) {
  char body[ANSWER_SIZE + 3];
  char check[5] = "";
  uint8_t size = 0;
  for (; *number != '\0'; number++) body[size++] = *number;
  body[size++] = ' ';
  for (; *text != '\0'; text++) body[size++] = *text;
  body[size] = '\0';
  writeHex(check, crc16(body, size));
  Serial.print("<");
  Serial.print(body);
  Serial.print("*");
  Serial.print(check);
  Serial.print("\n");
}

// Milliseconds in the text; 0 if it is not a number from 1 to LONGEST_MS.
unsigned long duration(const char *text) {
  unsigned long value = 0;
  if (*text == '\0') return 0;
  for (; *text != '\0'; text++) {
    if (*text < '0' || *text > '9') return 0;
    value = 10 * value + (unsigned long)(*text - '0');
    if (value > LONGEST_MS) return 0;
  }
  return value;
}

void fire(unsigned long pulse_ms) {
  digitalWrite(FOCUS_PIN, HIGH);
  delay(FOCUS_LEAD_MS);
  digitalWrite(SHUTTER_PIN, HIGH);
  delay(pulse_ms);
  digitalWrite(SHUTTER_PIN, LOW);
  digitalWrite(FOCUS_PIN, LOW);
}

const char *carryOut(const char *command) {
  if (strncmp(command, "FIRE ", 5) != 0) return "ERR command";
  unsigned long pulse_ms = duration(command + 5);
  if (pulse_ms == 0) return "ERR time";
  fire(pulse_ms);
  return "OK";
}

// The line lies between '>' and the end of line: SS COMMAND*CCCC
void handleLine() {
  if (length < 9 || line[length - 5] != '*') return;
  uint8_t bodySize = length - 5;
  char check[5] = "";
  writeHex(check, crc16(line, bodySize));
  if (strncmp(check, line + bodySize + 1, 4) != 0) return;
  line[bodySize] = '\0';
  if (!isHexDigit(line[0]) || !isHexDigit(line[1]) || line[2] != ' ') return;
  char number[3] = {line[0], line[1], '\0'};
  const char *command = line + 3;
  if (strcmp(command, "HELLO") == 0) {
    greeted = true;
    lastNumber[0] = '\0';
    answer(number, "OK lumisplit-trigger 1");
  } else if (!greeted) {
    answer(number, "ERR hello");
  } else {
    // A repeated request means that the answer was lost, not that another exposure is wanted.
    if (strcmp(number, lastNumber) != 0) {
      strcpy(lastAnswer, carryOut(command));
      strcpy(lastNumber, number);
    }
    answer(number, lastAnswer);
  }
}

void setup() {
  pinMode(FOCUS_PIN, OUTPUT);
  pinMode(SHUTTER_PIN, OUTPUT);
  digitalWrite(FOCUS_PIN, LOW);
  digitalWrite(SHUTTER_PIN, LOW);
  Serial.begin(BAUD);
}

void loop() {
  while (Serial.available() > 0) {
    char letter = (char)Serial.read();
    if (letter == '>') {
      inLine = true;
      length = 0;
    } else if (letter == '\n') {
      if (inLine) handleLine();
      inLine = false;
    } else if (inLine && length < LINE_SIZE) {
      line[length++] = letter;
    } else {
      inLine = false;
    }
  }
}
